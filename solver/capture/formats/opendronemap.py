"""OpenDroneMap's `odm_report/shots.geojson`, which downloads of WebODM have instead of `opensfm/`.

A feature's properties have its photo's `filename`, the `rotation` (an axis times an angle) from the world
to OpenCV's camera axes, and as `translation` the camera's place in the world. Its lens is one of
`cameras.json` beside the folder, in OpenSfM's form; a shot does not name it, but has its size and focal
length (`shots.py`).

The world is that of the map, metres with +X east, +Y north and +Z up, millions of them from its origin:
places are counted from among the cameras then. Without GPS it is OpenSfM's own, of any scale.
"""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..fields import Entry
from ..files import json_holds
from ..frames import pose_opengl_from_opencv, rigid
from ..intake import Capture, CaptureError, Found, PhotoFinder, assemble
from ..placement import far_origin, seen_from
from .opensfm import intrinsics_of, rotation_of

NAME = "OpenDroneMap shots.geojson"
PATTERNS = ("odm_report/shots.geojson", "shots.geojson", "*/odm_report/shots.geojson")

_UP = (0.0, 0.0, 1.0)


def recognises(file: Path) -> bool:
    return json_holds(file, "FeatureCollection", "filename", "rotation", count=1 << 16)


def read(path: Path, photos: PhotoFinder) -> Capture:
    features, lenses = Entry.of_file(path).objects("features"), _lenses(path)
    read_lenses = {}
    found = []
    for feature in features:
        shot = feature.inner("properties")
        name = shot.name("filename", "the shot names no photo", "download it again")
        pose = rigid(rotation_of(shot).T, shot.numbers("translation", 3))
        photo = photos.find(f"images/{name}", beside=path)
        intrinsics = None
        if photos.serves(photo):
            key = _lens_of(shot, lenses)
            if key not in read_lenses:
                read_lenses[key] = intrinsics_of(lenses.inner(key))
            intrinsics = read_lenses[key]
        found.append(Found(shot.where, name, photo, pose_opengl_from_opencv(pose), intrinsics))
    capture = assemble(path, NAME, found, photos, up=_UP)
    origin = np.round(far_origin(capture))  # whole metres, so that people can count back
    return replace(seen_from(capture, origin), metric=bool(origin.any()))


def _lenses(path: Path) -> Entry:
    beside = [folder / "cameras.json" for folder in (path.parent.parent, path.parent)]
    file = next((file for file in beside if file.is_file()), None)
    if file is None:
        raise CaptureError(
            path, "features", "the lenses, OpenDroneMap's cameras.json, are not beside its folder",
            "unpack all of the download, or give the project's opensfm/reconstruction.json",
        )  # fmt: skip
    lenses = Entry.of_file(file)
    if not lenses:
        raise CaptureError(file, "", "there is no lens in it", "download it again")
    return lenses


def _lens_of(shot: Entry, lenses: Entry) -> str:
    """The key of a shot's lens: the only one, or the only one of its size and focal length."""
    if len(lenses) == 1:
        return next(iter(lenses))
    fitting = [
        key
        for key, entry in lenses.items()
        if isinstance(entry, dict)
        and all(entry.get(side) == shot.get(side) for side in ("width", "height"))
        and _same(entry.get("focal", entry.get("focal_x")), shot.get("focal"))
    ]
    if len(fitting) != 1:
        raise shot.error(
            "focal",
            f"{'none' if not fitting else 'more than one'} of the lenses in {lenses.path.name} fits it",
            "give the project's opensfm/reconstruction.json",
        )
    return fitting[0]


def _same(one: Any, other: Any) -> bool:
    both = isinstance(one, (int, float)) and isinstance(other, (int, float))
    return both and math.isclose(one, other, rel_tol=1e-9)
