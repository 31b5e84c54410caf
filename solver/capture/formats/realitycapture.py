"""RealityCapture's and RealityScan's cameras: XMP sidecars beside the photos, or one CSV table
(`realitycapture_table`).

A sidecar NAME.xmp has the rotation from the world to OpenCV's camera axes, row by row, and the
camera's place. RealityScan writes its values as attributes or as elements, both by turns. The lens is
that of `realitycapture_lens`; a file with the division model is refused rather than read wrongly.
The world is right-handed with +Z up. All is for the pixels as they are stored, whatever the EXIF
orientation: https://github.com/nerfstudio-project/nerfstudio/pull/1261, where photos of RealityCapture's
own sample fit its table once they are not turned.
"""

import math
from pathlib import Path

import numpy as np

from ..errors import CaptureError, counted, shown
from ..fields import number, numbers
from ..files import read_xml, text_head
from ..frames import pose_opengl_from_opencv, rigid
from ..intake import Capture, Found, PhotoFinder, assemble
from .realitycapture_lens import CHOOSE_BROWN, brown_lens
from .realitycapture_table import UP, is_table, read_table

NAME = "RealityCapture"
PATTERNS = ("*.csv", "*.xmp", "*/*.xmp")

_NAMESPACE = "http://www.capturingreality.com/ns/xcr/1.1#"
_HEAD = 1 << 16
_LENSES = ("perspective", "brown3", "brown3t2", "brown4", "brown4t2")


def recognises(file: Path) -> bool:
    """True for a sidecar in RealityCapture's namespace, or a table with its columns."""
    return _NAMESPACE.encode() in text_head(file, _HEAD) or is_table(file)


def read(path: Path, photos: PhotoFinder) -> Capture:
    """Read a table of cameras, or all sidecars beside the one given and beside photos."""
    if _NAMESPACE.encode() in text_head(path, _HEAD):
        return _read_sidecars(path, photos)
    return read_table(path, NAME, photos)


def _read_sidecars(path: Path, photos: PhotoFinder) -> Capture:
    """All sidecars of the folder and of the photos below the capture's folder."""
    sidecars = {file: None for file in path.parent.iterdir() if file.suffix.lower() == ".xmp"}
    sidecars[path] = None
    for picture in photos.pictures():
        if (file := picture.with_suffix(".xmp")).is_file():
            sidecars[file] = picture
    posed, placeless, rigged = [], [], []
    for file in sorted(sidecars):
        if _NAMESPACE.encode() not in text_head(file, _HEAD):
            continue
        values = _values(file)
        if "Rotation" not in values or "Position" not in values:
            placeless.append(file.name)
        elif _coordinates(values) == "relative" and "Rig" in values:
            rigged.append(file.name)
        else:
            photo = sidecars[file] or photos.find(file.stem, beside=file)
            posed.append((file.name, _component(values), _from_sidecar(file, values, photo)))
    # Each component has a world of its own.
    components = [component for _, component, _ in posed]
    largest = max(components, key=components.count, default="")
    found = [one for _, component, one in posed if component == largest]
    elsewhere = [name for name, component, _ in posed if component != largest]
    warnings = []
    for names, what in (
        (placeless, "has|have no pose"),
        (rigged, "has|have a place in a rig, but none in the world,"),
        (elsewhere, "belongs|belong to another component than most"),
    ):
        if names:
            told = counted(f"{len(names)} sidecar|sidecars {what} and is|are left out")
            warnings.append(f"{told} (the first: {shown(names[0])})")
    if not found and (placeless or rigged):
        raise CaptureError(
            path, "xcr:Rotation" if placeless else "xcr:Coordinates",
            "no sidecar has a pose" if placeless else "all places are in a rig, none in the world",
            "export XMP with camera poses in RealityCapture",
        )  # fmt: skip
    return assemble(path, NAME, found, photos, up=UP, warnings=tuple(warnings))


def _coordinates(values: dict[str, str]) -> str:
    return values.get("Coordinates", "absolute").strip().lower()


def _component(values: dict[str, str]) -> str:
    """Of the world that a pose is in; "" is the world itself, which it is as well if none is named."""
    return values.get("ComponentId", "").strip() if _coordinates(values) != "absolute" else ""


def _values(file: Path) -> dict[str, str]:
    """The values of a sidecar in RealityCapture's namespace by their bare names."""
    prefix = f"{{{_NAMESPACE}}}"
    values: dict[str, str] = {}
    for element in read_xml(file).iter():
        pairs = [*element.attrib.items(), (element.tag, element.text or "")]
        for name, text in pairs:
            if isinstance(name, str) and name.startswith(prefix) and text.strip():
                values.setdefault(name[len(prefix) :], text)
    return values


def _from_sidecar(file: Path, values: dict[str, str], photo: Path | None) -> Found:
    rotation = numbers(file, "xcr:Rotation", values["Rotation"], 9).reshape(3, 3)
    pose = rigid(rotation.T, numbers(file, "xcr:Position", values["Position"], 3))
    intrinsics = None
    if photo is not None:

        def value(name: str, default: float) -> float:
            return number(file, f"xcr:{name}", values[name]) if name in values else default

        focal = value("FocalLength35mm", math.nan)
        if math.isnan(focal):
            raise CaptureError(file, "xcr:FocalLength35mm", "the focal length is missing")
        coefficients = np.zeros(6)
        if "DistortionCoeficients" in values:  # RealityCapture's spelling
            given = numbers(file, "xcr:DistortionCoeficients", values["DistortionCoeficients"])
            coefficients[: min(6, len(given))] = given[:6]
        model = values.get("DistortionModel", "brown3").strip().lower()
        if model in ("none", "perspective"):
            coefficients[:] = 0
        if model not in _LENSES and coefficients.any():
            raise CaptureError(
                file, "xcr:DistortionModel", f"the lens model '{shown(model)}' is not supported",
                CHOOSE_BROWN,
            )  # fmt: skip
        intrinsics = brown_lens(
            photo, focal, value("PrincipalPointU", 0.0), value("PrincipalPointV", 0.0),
            coefficients[:4].tolist(), coefficients[4], coefficients[5],
            value("Skew", 0.0), value("AspectRatio", 1.0),
        )  # fmt: skip
    return Found(f"{file.name}, xcr:Rotation", file.stem, photo, pose_opengl_from_opencv(pose), intrinsics)
