"""RealityCapture's and RealityScan's cameras: XMP sidecars beside the photos, or one CSV table.

The table is "Internal/External camera parameters" (columns name, x, y, alt, heading or yaw, pitch,
roll, f, px, py, k1 … k4, t1, t2; in degrees). With all angles 0 a camera looks down with north on
top; heading turns it clockwise as seen from above, pitch 90° lifts the view to the horizon.

A sidecar NAME.xmp has the rotation from the world to OpenCV's camera axes, row by row, and the
camera's place. RealityScan writes its values as attributes or as elements, both by turns.

The lens of both ("RealityCapture XMP Camera Math"), with s the longer side of the photo in pixels:

    x = X / Z, y = Y / Z
    x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸) + t1 (r² + 2 x²) + 2 t2 x y
    y' = y (1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸) + t2 (r² + 2 y²) + 2 t1 x y
    u = w / 2 + s (f / 36 x' + skew y' + px)
    v = h / 2 + s (f / 36 aspect y' + py)

so t1 and t2 are OpenCV's p2 and p1: RealityCapture's "OpenCV-compliant" table swaps them. Its division
model is another formula, in another order; a file with it is refused rather than read wrongly.
The world is right-handed with +Z up.
"""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np

from ..brown_lens import polynomial_lens
from ..capture import Capture
from ..errors import CaptureError, shown
from ..files import as_text, head_of, number, numbers, read_text, read_xml
from ..frames import pose_opengl_from_opencv
from ..image_header import image_size
from ..intake import Found, Intrinsics, assemble
from ..photo_finder import PhotoFinder

NAME = "RealityCapture"
EXTENSIONS = (".csv", ".xmp")
PATTERNS = ("*.csv", "*.xmp", "*/*.xmp")

_NAMESPACE = "http://www.capturingreality.com/ns/xcr/1.1#"
_UP = (0.0, 0.0, 1.0)
_SAME_COLUMNS = {"yaw": "heading", "f_35mm": "f", "px_norm": "px", "py_norm": "py", "z": "alt"}
_NEEDED = ("name", "x", "y", "alt", "heading", "pitch", "roll", "f")
_SEPARATORS = (",", ";", "\t")
"""of columns; after all but the comma, Excel writes decimals with a comma where people do"""
_LENSES = ("perspective", "brown3", "brown3t2", "brown4", "brown4t2")


def recognises(file: Path) -> bool:
    """True for a sidecar in RealityCapture's namespace, or a table with its columns."""
    head = head_of(file)
    return _NAMESPACE.encode() in head or _table_of(as_text(head)) is not None


def is_table_without_lenses(file: Path) -> bool:
    """True for RealityCapture's other tables, of places or of places and angles, which have no lenses."""
    lines = as_text(head_of(file)).splitlines()[:5]
    headers = (_names(line.split(separator)) for line in lines for separator in _SEPARATORS)
    places = any(names[:3] == ["name", "x", "y"] for names in headers)
    return places and not recognises(file)


def read(path: Path, photos: PhotoFinder) -> Capture:
    """Read a table of cameras, or all sidecars beside the one given and beside photos.

    Raises:
        CaptureError: anything that cannot be used, with file, field and remedy.
    """
    if _NAMESPACE.encode() in head_of(path):
        return _read_sidecars(path, photos)
    return _read_table(path, photos)


def _table_of(head: str) -> tuple[dict[str, int], str] | None:
    """Columns and their separator, by the line that names them; None if this is no table of cameras.

    RealityCapture may put `#cameras 12` before it; Excel saves tables again with other separators.
    """
    for line in head.splitlines()[:5]:
        for separator in _SEPARATORS:
            if (columns := _columns(line.split(separator))) is not None:
                return columns, separator
    return None


def _columns(header: list[str]) -> dict[str, int] | None:
    """Positions of the columns by their names; None if some are missing."""
    found = {name: index for index, name in enumerate(_names(header)) if name}
    return found if all(name in found for name in _NEEDED) else None


def _names(header: list[str]) -> list[str]:
    """Columns as they are called here."""
    names = (name.strip().strip('"').lstrip("#").strip().lower() for name in header)
    return [_SAME_COLUMNS.get(name, name) for name in names]


def _read_table(path: Path, photos: PhotoFinder) -> Capture:
    text = read_text(path)
    table = _table_of(text[:65536])
    if table is None:
        raise CaptureError(
            path, "line 1", "the columns of RealityCapture's table are missing",
            "export 'Internal/External camera parameters' again",
        )  # fmt: skip
    columns, separator = table
    found = []
    try:
        rows = list(enumerate(csv.reader(text.splitlines(), delimiter=separator), 1))
    except csv.Error as error:
        raise CaptureError(path, "", f"this is no table ({error})", "export it again") from error
    for line, row in rows:
        if not row or not row[0].strip() or row[0].lstrip().startswith("#"):
            continue
        if _columns(row) is not None:
            continue
        where = f"line {line}"
        if len(row) <= max(columns.values()):
            raise CaptureError(path, where, "the line is cut off", "export the cameras again")

        def value(name: str, row: list[str] = row, where: str = where) -> float:
            if name not in columns:
                return 0.0
            text = row[columns[name]]
            if separator != ",":
                text = text.replace(",", ".")
            return number(path, f"{where}, {name}", text)

        stated = row[columns["name"]].strip()
        photo = photos.find(stated, beside=path)
        intrinsics = None
        if photo is not None:
            radial = [value(name) for name in ("k1", "k2", "k3", "k4")]
            intrinsics = _intrinsics(
                photo, value("f"), value("px"), value("py"), radial, value("t1"), value("t2")
            )
        pose = np.eye(4)
        pose[:3, :3] = _rotation(value("heading"), value("pitch"), value("roll"))
        pose[:3, 3] = value("x"), value("y"), value("alt")
        found.append(Found(where, stated, photo, pose, intrinsics))
    return assemble(path, NAME, found, photos, up=_UP)


def _rotation(heading: float, pitch: float, roll: float) -> np.ndarray:
    """Camera to world [3, 3] with OpenGL's camera axes, of angles in degrees."""
    turns = np.radians([-heading, pitch, roll])
    (c, cp, cr), (s, sp, sr) = np.cos(turns), np.sin(turns)
    about_z = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
    about_y = np.array([[cr, 0, sr], [0, 1, 0], [-sr, 0, cr]])
    return about_z @ about_x @ about_y


def _intrinsics(
    photo: Path, focal: float, px: float, py: float, radial: list[float], t1: float, t2: float,
    skew: float = 0.0, aspect: float = 1.0,
) -> Intrinsics:  # fmt: skip
    """The lens on a photo as it is now: all lengths are in terms of its longer side."""
    width, height = image_size(photo)
    longer = max(width, height)
    fx = focal / 36 * longer
    lens, distortion = polynomial_lens(radial, (t2, t1), skew * longer / fx if fx else 0.0)
    return Intrinsics(
        width, height, fx, fx * aspect, 0.5 * width + px * longer, 0.5 * height + py * longer,
        lens, distortion,
    )  # fmt: skip


def _read_sidecars(path: Path, photos: PhotoFinder) -> Capture:
    """All sidecars of the folder and of the photos below the capture's folder."""
    sidecars = {file: None for file in path.parent.iterdir() if file.suffix.lower() == ".xmp"}
    sidecars[path] = None
    for picture in photos.pictures():
        if (file := picture.with_suffix(".xmp")).is_file():
            sidecars[file] = picture
    posed, placeless, rigged = [], [], []
    for file in sorted(sidecars):
        if _NAMESPACE.encode() not in head_of(file):
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
        (placeless, "have no pose"),
        (rigged, "have a place in a rig, but none in the world,"),
        (elsewhere, "belong to another component than most"),
    ):
        if names:
            warnings.append(
                f"{len(names)} sidecars {what} and are left out (the first: {shown(names[0])})"
            )
    if not found and (placeless or rigged):
        raise CaptureError(
            path, "xcr:Rotation" if placeless else "xcr:Coordinates",
            "no sidecar has a pose" if placeless else "all places are in a rig, none in the world",
            "export XMP with camera poses in RealityCapture",
        )  # fmt: skip
    return assemble(path, NAME, found, photos, up=_UP, warnings=tuple(warnings))


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
    pose = np.eye(4)
    pose[:3, :3] = rotation.T
    pose[:3, 3] = numbers(file, "xcr:Position", values["Position"], 3)
    intrinsics = None
    if photo is not None:

        def value(name: str, default: float) -> float:
            return number(file, f"xcr:{name}", values[name]) if name in values else default

        focal = value("FocalLength35mm", math.nan)
        if math.isnan(focal):
            raise CaptureError(
                file, "xcr:FocalLength35mm", "the focal length is missing", "export it again"
            )
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
                "set Brown as distortion model in the alignment settings, update the cameras, and "
                "export them again",
            )  # fmt: skip
        intrinsics = _intrinsics(
            photo, focal, value("PrincipalPointU", 0.0), value("PrincipalPointV", 0.0),
            coefficients[:4].tolist(), coefficients[4], coefficients[5],
            value("Skew", 0.0), value("AspectRatio", 1.0),
        )  # fmt: skip
    return Found(f"{file.name}, xcr:Rotation", file.stem, photo,
                 pose_opengl_from_opencv(pose), intrinsics)  # fmt: skip
