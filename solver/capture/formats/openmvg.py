"""OpenMVG's `sfm_data.json`: views, intrinsics, extrinsics and sparse points.

It is what the library cereal makes of OpenMVG's classes: an object's type has a `polymorphic_id`, and
its `polymorphic_name` only where the id comes first (with the highest bit set); members of a base
class may lie in `value0`. Rotations [3, 3] are lists of rows from the world to OpenCV's camera axes,
`center` is the camera's place. A view without pose was not localised.

Lenses are OpenCV's (t1, t2 are p1, p2). OpenMVG's features count pixels from the centre of the first
one, but half the picture's size, its start for the principal point, means the middle: so it does here.

`spherical` is a panorama of azimuth and elevation; both are counted in turns, and lengths in the picture's
longer side (`Camera_Spherical.cpp`). Its +Y is down as every lens's; until November 2017 it was up, and
worlds were mirrored (issue 1133), which the file does not tell.
"""

from pathlib import Path
from typing import Any

import numpy as np

from ..brown_lens import polynomial_lens
from ..capture import Capture
from ..errors import CaptureError, shown
from ..fields import entries, mapping, number, numbers
from ..files import json_head, read_json
from ..frames import pose_opengl_from_opencv
from ..intake import Found, Intrinsics, assemble, without_pose
from ..panoramic_lens import EQUIRECTANGULAR, in_turns
from ..photo_finder import PhotoFinder

NAME = "OpenMVG sfm_data.json"
EXTENSIONS = (".json",)
PATTERNS = (
    # A project's matches/sfm_data.json has no poses.
    "sfm_data.json", "sfm_data*.json", "reconstruction*/sfm_data*.json", "*/sfm_data*.json",
)  # fmt: skip

_FIRST_USE = 1 << 31
_DISTORTION = {
    "pinhole": ("", 0),
    "pinhole_radial_k1": ("disto_k1", 1),
    "pinhole_radial_k3": ("disto_k3", 3),
    "pinhole_brown_t2": ("disto_t2", 5),
    "fisheye": ("fisheye", 4),
}
"""where a lens has its numbers, and how many"""
_PANORAMA = "spherical"


def recognises(file: Path) -> bool:
    """True for JSON with OpenMVG's version, also if it is cut off."""
    return b'"sfm_data_version"' in json_head(file)


def read(path: Path, photos: PhotoFinder) -> Capture:
    """Read a scene; views without a pose are left out with a warning."""
    content = mapping(path, "", read_json(path))
    root = content.get("root_path")
    root = root if isinstance(root, str) else ""
    intrinsics = _intrinsics_by_id(path, content.get("intrinsics"))
    poses = {}
    for index, entry in enumerate(entries(path, "extrinsics", content.get("extrinsics"))):
        where = f"extrinsics[{index}]"
        entry = mapping(path, where, entry)
        poses[_key(path, where, entry)] = where, mapping(path, where, entry.get("value"))
    views = entries(path, "views", content.get("views"))
    found, lost = [], []
    for index, entry in enumerate(views):
        where = f"views[{index}]"
        view = _data(path, where, mapping(path, where, entry).get("value"))
        name = view.get("filename")
        if not isinstance(name, str) or not name:
            raise CaptureError(path, f"{where}.filename", "the view names no photo")
        folder = view.get("local_path")
        parts = [part for part in (root, folder, name) if isinstance(part, str) and part]
        stated = "/".join(parts)
        pose = poses.get(_identity(view.get("id_pose")))
        lens = intrinsics.get(_identity(view.get("id_intrinsic")))
        if pose is None or lens is None:
            lost.append(name)
            continue
        photo = photos.find(stated, beside=path)
        found.append(Found(pose[0], stated, photo, _camera_to_world(path, *pose), lens))
    warnings = without_pose(
        path, "extrinsics", lost, len(views), "give the file that a reconstruction has written, as JSON"
    )  # fmt: skip
    return assemble(
        path, NAME, found, photos, points=_points(path, content.get("structure")), warnings=warnings
    )


def _identity(value: Any) -> int | None:
    return value if isinstance(value, int) and not isinstance(value, bool) else None


def _key(path: Path, where: str, entry: dict) -> int:
    key = _identity(entry.get("key"))
    if key is None:
        raise CaptureError(path, f"{where}.key", "the key is not a number")
    return key


def _data(path: Path, where: str, value: Any) -> dict:
    """The members of an object behind cereal's pointer, those of its base class among them."""
    wrapper = mapping(path, where, mapping(path, where, value).get("ptr_wrapper"))
    data = mapping(path, where, wrapper.get("data"))
    for _ in range(8):
        base = data.get("value0")
        if not isinstance(base, dict):
            break
        data = {**base, **{name: item for name, item in data.items() if name != "value0"}}
    return data


def _camera_to_world(path: Path, where: str, value: dict) -> np.ndarray:
    rows = entries(path, f"{where}.rotation", value.get("rotation"))
    if len(rows) != 3:
        raise CaptureError(path, f"{where}.rotation", "it does not have 3 rows")
    pose = np.eye(4)
    pose[:3, :3] = np.stack([numbers(path, f"{where}.rotation", row, 3) for row in rows]).T
    pose[:3, 3] = numbers(path, f"{where}.center", value.get("center"), 3)
    return pose_opengl_from_opencv(pose)


def _intrinsics_by_id(path: Path, stated: Any) -> dict[int, Intrinsics]:
    listed = []
    for index, entry in enumerate(entries(path, "intrinsics", stated)):
        entry = mapping(path, f"intrinsics[{index}]", entry)
        listed.append((entry, mapping(path, f"intrinsics[{index}].value", entry.get("value"))))
    names: dict[int | None, str] = {}
    for _, value in listed:
        if isinstance(name := value.get("polymorphic_name"), str):
            names[_type_of(value)] = name
    found = {}
    for index, (entry, value) in enumerate(listed):
        where = f"intrinsics[{index}]"
        name = value.get("polymorphic_name", names.get(_type_of(value)))
        if not isinstance(name, str):
            raise CaptureError(path, f"{where}.polymorphic_name", "the lens has no name")
        found[_key(path, where, entry)] = _intrinsics(path, where, name, _data(path, where, value))
    return found


def _type_of(value: dict) -> int | None:
    identity = _identity(value.get("polymorphic_id"))
    return None if identity is None else identity & (_FIRST_USE - 1)


def _intrinsics(path: Path, where: str, name: str, data: dict) -> Intrinsics:
    if name not in _DISTORTION and name != _PANORAMA:
        raise CaptureError(
            path, f"{where}.polymorphic_name", f"the lens model '{shown(name)}' is not supported",
            "use one of " + ", ".join((*_DISTORTION, _PANORAMA)),
        )  # fmt: skip
    width, height = (
        int(number(path, f"{where}.{key}", data.get(key))) for key in ("width", "height")
    )
    if name == _PANORAMA:
        return Intrinsics(width, height, *in_turns(width, height), EQUIRECTANGULAR)
    focal = number(path, f"{where}.focal_length", data.get("focal_length"))
    cx, cy = numbers(path, f"{where}.principal_point", data.get("principal_point"), 2)
    key, count = _DISTORTION[name]
    given = data.get(key, [])
    given = [given] if isinstance(given, (int, float)) else given
    k = numbers(path, f"{where}.{key}", given, count)
    if name == "fisheye":
        lens = polynomial_lens(k, equidistant=True)
    else:
        lens = polynomial_lens(k[:3], k[3:] if len(k) == 5 else (0.0, 0.0))
    return Intrinsics(width, height, focal, focal, float(cx), float(cy), *lens)


def _points(path: Path, stated: Any) -> np.ndarray | None:
    rows = []
    for index, entry in enumerate(entries(path, "structure", stated)):
        where = f"structure[{index}]"
        value = mapping(path, where, mapping(path, where, entry).get("value"))
        rows.append(numbers(path, f"{where}.X", value.get("X"), 3))
    return np.array(rows) if rows else None
