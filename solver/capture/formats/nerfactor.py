"""Cameras of NeRFactor's data sets, and of TensoIR's and others that are rendered in their layout.

    train_000/metadata.json, train_000/rgba.png, train_001/metadata.json, …, val_000/…, test_000/…

`cam_transform_mat` is a text of 16 numbers, row by row, from the camera, with OpenGL's axes, to the world;
`cam_angle_x` the field of view in radians over `imw` pixels of `imw` × `imh`, whose middle the axis meets.
Any one of the files stands for all whose folders are called alike. Where a transforms_train.json lies
beside these folders, as mostly, that is read.
https://github.com/google/nerfactor (nerfactor/datasets/nerf.py: `_load_data`, `_gen_rays`)
"""

import math
import re
from pathlib import Path

from ..camera_folder import MOST_FILES, listing
from ..fields import Entry
from ..files import json_holds
from ..intake import Capture, Found, Intrinsics, PhotoFinder, assemble
from ..picture_names import numbered

NAME = "NeRFactor"
_FILE, _PHOTO = "metadata.json", "rgba"
PATTERNS = (f"train_[0-9]*/{_FILE}",)

_VIEW = re.compile(r"(.+_)\d+")


def recognises(file: Path) -> bool:
    return json_holds(file, "cam_transform_mat", count=1 << 16)


def read(path: Path, photos: PhotoFinder) -> Capture:
    files = _views(path)
    return assemble(path, NAME, [_camera(file, photos) for file in files], photos)


def _views(path: Path) -> list[Path]:
    folder = path.absolute().parent
    if (kind := _kind(folder)) is None:
        return [path]
    with listing(folder.parent):
        beside = [other for other in folder.parent.iterdir() if _kind(other) == kind]
    files = [file for other in beside if (file := other / path.name).is_file()]
    return sorted(files, key=lambda file: numbered(file.parent.name))[:MOST_FILES]


def _kind(folder: Path) -> str | None:
    """What a view's folder is called before its number."""
    view = _VIEW.fullmatch(folder.name)
    return view and view[1]


def _camera(file: Path, photos: PhotoFinder) -> Found:
    content = Entry.of_file(file)
    pose = content.numbers("cam_transform_mat", 16).reshape(4, 4)
    width, height = int(content.number("imw")), int(content.number("imh"))
    angle = content.number("cam_angle_x")
    if not 0 < angle < math.pi:
        raise content.error(
            "cam_angle_x", f"{angle} is not a field of view in radians", "give an angle below 3.14"
        )
    photo = photos.find_in(file.parent, _PHOTO)
    focal = 0.5 * width / math.tan(0.5 * angle)
    lens = Intrinsics(width, height, focal, focal, width / 2, height / 2)
    where = f"{file.parent.name}/{file.name}, cam_transform_mat"
    return Found(where, f"{file.parent.name}/{_PHOTO}", photo, pose, lens)
