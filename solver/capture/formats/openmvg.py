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
from ..errors import shown
from ..fields import Entry, numbers
from ..files import json_holds
from ..frames import pose_opengl_from_opencv, rigid
from ..intake import Capture, Found, Intrinsics, PhotoFinder, assemble
from ..panoramic_lens import EQUIRECTANGULAR, in_turns

NAME = "OpenMVG sfm_data.json"
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
    return json_holds(file, "sfm_data_version")


def read(path: Path, photos: PhotoFinder) -> Capture:
    content = Entry.of_file(path)
    root = content.get("root_path")
    intrinsics = _intrinsics_by_id(content)
    poses: dict[int | None, Entry] = {}
    for entry in content.objects("extrinsics"):
        poses[_key(entry)] = entry.within("value")
    found, lost = [], []
    for view in map(_data, content.objects("views")):
        name = view.name("filename", "the view names no photo")
        folders = (root, view.get("local_path"))
        stated = "/".join((*(f for f in folders if isinstance(f, str) and f), name))
        pose = poses.get(_identity(view.get("id_pose")))
        lens = intrinsics.get(_identity(view.get("id_intrinsic")))
        if pose is None or lens is None:
            lost.append(name)
            continue
        photo = photos.find(stated, beside=path)
        to_world = rigid(pose.matrix("rotation", (3, 3)).T, pose.numbers("center", 3))
        found.append(Found(pose.where, stated, photo, pose_opengl_from_opencv(to_world), lens))
    points = [point.within("value").numbers("X", 3) for point in content.objects("structure")]
    lost = lost, "extrinsics", "give the file that a reconstruction has written, as JSON"
    return assemble(path, NAME, found, photos, points=np.array(points), lost=lost)


def _identity(value: Any) -> int | None:
    return value if isinstance(value, int) and not isinstance(value, bool) else None


def _key(entry: Entry) -> int:
    key = _identity(entry.get("key"))
    if key is None:
        raise entry.error("key", "the key is not a number")
    return key


def _data(entry: Entry) -> Entry:
    """The members of an object behind cereal's pointer, those of its base class among them."""
    data = entry.within("value").within("ptr_wrapper").within("data")
    for _ in range(8):
        if not isinstance(data.get("value0"), dict):
            break
        base = data.pop("value0")
        data = Entry(entry.path, entry.where, {**base, **data})
    return data


def _intrinsics_by_id(content: Entry) -> dict[int, Intrinsics]:
    listed = [(entry, entry.inner("value")) for entry in content.objects("intrinsics")]
    names: dict[int | None, str] = {}
    for _, value in listed:
        if isinstance(name := value.get("polymorphic_name"), str):
            names[_type_of(value)] = name
    found = {}
    for entry, value in listed:
        name = value.get("polymorphic_name", names.get(_type_of(value)))
        if not isinstance(name, str):
            raise entry.error("polymorphic_name", "the lens has no name")
        found[_key(entry)] = _intrinsics(name, _data(entry))
    return found


def _type_of(value: Entry) -> int | None:
    identity = _identity(value.get("polymorphic_id"))
    return None if identity is None else identity & (_FIRST_USE - 1)


def _intrinsics(name: str, data: Entry) -> Intrinsics:
    if name not in _DISTORTION and name != _PANORAMA:
        raise data.error(
            "polymorphic_name", f"the lens model '{shown(name)}' is not supported",
            "use one of " + ", ".join((*_DISTORTION, _PANORAMA)),
        )  # fmt: skip
    width, height = int(data.number("width")), int(data.number("height"))
    if name == _PANORAMA:
        return Intrinsics(width, height, *in_turns(width, height), EQUIRECTANGULAR)
    focal = data.number("focal_length")
    cx, cy = data.numbers("principal_point", 2)
    key, count = _DISTORTION[name]
    given = data.get(key, [])
    given = [given] if isinstance(given, (int, float)) else given
    k = numbers(data.path, data.field(key), given, count)
    if name == "fisheye":
        lens = polynomial_lens(k, equidistant=True)
    else:
        lens = polynomial_lens(k[:3], k[3:] if len(k) == 5 else (0.0, 0.0))
    return Intrinsics(width, height, focal, focal, float(cx), float(cy), *lens)
