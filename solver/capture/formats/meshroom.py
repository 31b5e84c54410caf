"""Meshroom's (AliceVision's) `cameras.sfm` and other SfM data in JSON.

Numbers are written as text, empty lists as "". A pose's rotation is written column by column, from
the world to OpenCV's camera axes, so the nine numbers row by row are the camera's rotation in the
world; `center` is its place. Cameras of a rig have a pose in the rig besides the rig's own.

What changed with the versions of the file (`jsonIO.cpp`, scenes in `sfmDataIO/compatibilityData`):

    before 1.2.0   pxFocalLength is one number
    1.2.0          pxFocalLength has one number for each axis
    1.2.1          principalPoint is relative to the picture's centre, not to its corner
    1.2.2          focalLength in mm of sensorWidth, along x; pixelRatio is fx / fy
    1.2.5          pixelRatio is fy / fx
    1.2.8          the distortion has a type of its own, before it was the camera's
    1.2.9 … 1.2.11 focalLength is along y

Which version between 1.2.9 and 1.2.11 made the last change matters only if pixels are not square.

A camera of the type equidistant has its angles from the axis in shares of that at which its circle ends,
half of the sensor's shorter side over the focal length, before the distortion; then these are shares of the
circle's radius (`Equidistant.cpp`). The distortion fisheye1 is the lens fov (`DistortionFisheye1.cpp`).
Of one of the type equirectangular the focal length is that of a radian (`Equirectangular.cpp`).

AliceVision's features count pixels from the centre of the first one, but an offset of 0, which a file
has unless the point was refined, means the middle of the picture to everyone: so it does here, too.
"""

import re
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from ..brown_lens import polynomial_lens
from ..errors import CaptureError, shown
from ..fields import Entry
from ..files import head_of, json_head
from ..frames import pose_opengl_from_opencv, rigid
from ..intake import Capture, Found, Intrinsics, PhotoFinder, assemble
from ..panoramic_lens import EQUIRECTANGULAR

NAME = "Meshroom SfM data"
PATTERNS = (
    "cameras.sfm", "sfm.sfm", "*.sfm", "sfm.json", "cameras.json", "*/cameras.sfm", "*/*.sfm",
    "MeshroomCache/StructureFromMotion/*/cameras.sfm", "MeshroomCache/*/*/*.sfm",
    "StructureFromMotion/*/cameras.sfm", "*/*/*.sfm",
)  # fmt: skip

_DISTORTION_OF_CAMERA = {
    "pinhole": "none", "radial1": "radialk1", "radial3": "radialk3", "brown": "brown",
    "fisheye4": "fisheye", "fisheye": "fisheye", "fisheye1": "fisheye1", "equidistant": "none",
    "equidistant_r3": "radialk3pt", "equirectangular": "none",
}  # fmt: skip
_COUNTS = {"none": 0, "radialk1": 1, "radialk3": 3, "radialk3pt": 3, "brown": 5, "fisheye": 4,
           "fisheye1": 1}  # fmt: skip
_OF_ANGLES = ("none", "radialk1", "radialk3", "radialk3pt")
"""distortions that are known of the type equidistant"""
_MOST_TO_SEARCH = 1 << 26
"""bytes of a file that are searched for poses; what is larger has points, and so poses"""
_BINARY = b"ASFM"
"""identity of AliceVision's FlatBuffers (`FlatBuffersIO.cpp`), from the fifth byte on"""
_POSES = re.compile(rb'"poses"\s*:\s*\[\s*\{')


def recognises(file: Path) -> bool:
    """True for JSON with AliceVision's views, also if it is cut off, and for its binary form, to say so."""
    return b'"viewId"' in json_head(file) or head_of(file, 8)[4:] == _BINARY


def last_solved(files: Iterable[Path]) -> Path | None:
    """The first of some files that has poses, or what was written later in its place; else the first.

    CameraInit's file has no poses, and Meshroom's cache keeps a folder for all settings that were tried.
    """
    files = list(files)
    solved = [file for file in files if _has_poses(file)]
    if not solved:
        return next(iter(files), None)
    node, name = solved[0].parent.parent, solved[0].name
    tried = (file for file in solved if file.parent.parent == node and file.name == name)
    return max(tried, key=lambda file: file.stat().st_mtime)


def _has_poses(file: Path) -> bool:
    with suppress(OSError):
        large = file.stat().st_size > _MOST_TO_SEARCH
        return large or _POSES.search(file.read_bytes()) is not None
    return False


def read(path: Path, photos: PhotoFinder) -> Capture:
    if head_of(path, 8)[4:] == _BINARY:
        raise CaptureError(
            path, "", "this is AliceVision's binary form, which is not supported",
            "convert it to JSON by Meshroom's node ConvertSfMFormat",
        )  # fmt: skip
    content = Entry.of_file(path)
    if "viewpoints" in content or "graph" in content:
        raise content.error(
            "graph", "this is a project of Meshroom", "give the cameras.sfm it has computed"
        )
    version = _version(content)
    lenses = {_identity(lens.get("intrinsicId")): lens for lens in content.objects("intrinsics")}
    poses, rigs = _poses(content), _rigs(content)
    read_lenses: dict[str | None, Intrinsics] = {}
    found, lost = [], []
    for view in content.objects("views"):
        stated = view.name("path", "the view names no photo")
        pose = poses.get(_identity(view.get("poseId")))
        if _word(view.get("isPoseIndependant", "true")) in ("0", "false"):
            inner = rigs.get((_identity(view.get("rigId")), _identity(view.get("subPoseId"))))
            pose = None if pose is None or inner is None else pose @ inner
        key = _identity(view.get("intrinsicId"))
        if pose is None or key not in lenses:
            lost.append(stated)
            continue
        photo = photos.find(stated, beside=path)
        if photos.serves(photo) and key not in read_lenses:
            read_lenses[key] = _intrinsics(lenses[key], version)
        found.append(Found(view.where, stated, photo, pose_opengl_from_opencv(pose), read_lenses.get(key)))
    points = [point.numbers("X", 3) for point in content.objects("structure")]
    lost = lost, "poses", "give the file that the node StructureFromMotion has written"
    return assemble(path, NAME, found, photos, points=np.array(points), lost=lost)


def _identity(value: Any) -> str | None:
    """An identity as text: some writers give numbers."""
    return str(value) if isinstance(value, (int, str)) and not isinstance(value, bool) else None


def _word(value: Any) -> str:
    return shown(value).strip().lower()


def _version(content: Entry) -> tuple[int, ...]:
    """(major, minor, revision); files without one are of the first."""
    if content.get("version") in (None, "", []):
        return (1, 0, 0)
    values = content.numbers("version")
    if not (np.abs(values) < 1e6).all():
        raise content.error("version", "this is not a version")
    return tuple(int(value) for value in values)


def _poses(content: Entry) -> dict[str | None, np.ndarray]:
    """Camera-to-world matrices [4, 4] with OpenCV's axes by their identities."""
    found = {}
    for entry in content.objects("poses"):
        found[_identity(entry.get("poseId"))] = _pose(entry.inner("pose").inner("transform"))
    return found


def _rigs(content: Entry) -> dict[tuple[str | None, str], np.ndarray]:
    """Camera-to-rig matrices [4, 4] by the identities of the rig and of the place in it."""
    found = {}
    for rig in content.objects("rigs"):
        for place, entry in enumerate(rig.objects("subPoses")):
            found[_identity(rig.get("rigId")), str(place)] = _pose(entry.inner("pose"))
    return found


def _pose(transform: Entry) -> np.ndarray:
    rotation = transform.numbers("rotation", 9).reshape(3, 3)
    return rigid(rotation, transform.numbers("center", 3))


def _intrinsics(entry: Entry, version: tuple[int, ...]) -> Intrinsics:
    def value(name: str, default: float) -> float:
        return default if entry.get(name) in (None, "") else entry.number(name)

    width, height = int(entry.number("width")), int(entry.number("height"))
    if version < (1, 2, 0):
        fx = fy = entry.number("pxFocalLength")
    elif version < (1, 2, 2):
        fx, fy = entry.numbers("pxFocalLength", 2)
    else:
        fx = fy = entry.number("focalLength") / max(value("sensorWidth", 36.0), 1e-9) * width
        ratio = value("pixelRatio", 1.0)
        if not 1e-3 < ratio < 1e3:
            raise entry.error("pixelRatio", "it is not positive", "correct it")
        if version < (1, 2, 5):
            fy = fx / ratio
        elif version < (1, 2, 9):
            fy = fx * ratio
        else:
            fx = fy / ratio
    cx, cy = entry.numbers("principalPoint", 2)
    if version >= (1, 2, 1):
        cx, cy = cx + 0.5 * width, cy + 0.5 * height
    if _word(entry.get("type", "")) in ("equidistant", "equidistant_r3"):
        wide = value("sensorWidth", 36.0)
        shorter = min(wide, value("sensorHeight", wide * height / width))
        # Twice the focal length in terms of the shorter side: one over the angle at which the circle ends.
        shares = 2 * float(fx) * wide / max(width, height) / max(shorter, 1e-9)
        radius = value("fisheyeCircleRadius", min(width, height) / 2)
        shrink, lens, distortion = _lens_of_angles(entry, shares)
        fx = fy = radius * shares
    else:
        shrink, lens, distortion = _lens(entry)
    return Intrinsics(
        width, height, float(fx) * shrink, float(fy) * shrink, float(cx), float(cy), lens, distortion
    )


def _lens(entry: Entry) -> tuple[float, str, tuple[float, ...]]:
    """What the lens does to the focal lengths, its name and its numbers."""
    if _word(entry.get("type", "")) == EQUIRECTANGULAR:
        _distortion(entry, ("none",))
        return 1.0, EQUIRECTANGULAR, ()
    model, k = _distortion(entry, tuple(_COUNTS))
    if model == "fisheye":
        return 1.0, *polynomial_lens(k, equidistant=True)
    if model == "fisheye1":
        return 1.0, "fov", k
    if model == "brown":
        return 1.0, *polynomial_lens(k[:3], k[3:])
    return _shrunk(entry, model, k), *polynomial_lens(k)


def _lens_of_angles(entry: Entry, shares: float) -> tuple[float, str, tuple[float, ...]]:
    """The same of the type equidistant, whose distortion is of `shares` times the angle."""
    model, k = _distortion(entry, _OF_ANGLES)
    of_angles = [value * shares ** (2 * power) for power, value in enumerate(k, 1)]
    return _shrunk(entry, model, k), *polynomial_lens(of_angles, equidistant=True)


def _distortion(entry: Entry, known: tuple[str, ...]) -> tuple[str, tuple[float, ...]]:
    """A distortion's model, one of those `known`, and as many numbers as it has."""
    camera = _word(entry.get("type", ""))
    model = _word(entry.get("distortionType", _DISTORTION_OF_CAMERA.get(camera, camera)))
    undistortion = _word(entry.get("undistortionType", "none"))
    k = entry.numbers("distortionParams") if entry.get("distortionParams") else np.zeros(0)
    if not k.any():
        model = "none" if model != "fisheye" else model
    wrong = camera if camera not in _DISTORTION_OF_CAMERA else ""
    wrong = wrong or (model if model not in known else "")
    wrong = wrong or (undistortion if undistortion != "none" else "")
    if wrong:
        raise entry.error(
            "type", f"the lens model '{shown(wrong)}' is not supported",
            "choose pinhole with the distortion radialk3, brown or fisheye4, or equidistant with radialk3, "
            "in Meshroom's CameraInit and solve again",
        )  # fmt: skip
    return model, (*k.tolist(), 0.0, 0.0, 0.0, 0.0, 0.0)[: _COUNTS[model]]


def _shrunk(entry: Entry, model: str, k: tuple[float, ...]) -> float:
    """What a radial distortion does to the focal lengths: one model's leaves the radius 1 where it is."""
    if model != "radialk3pt":
        return 1.0
    total = 1 + sum(k)
    if not total > 1e-6:
        raise entry.error("distortionParams", "they turn the image over", "solve again")
    return 1 / total
