"""Cameras of the data set Objects with Lighting.

    inputs/camera_0000.txt …   beside image_0000.png and mask_0000.png

Eight lines of three numbers are a lens, in pixels counted from the corner of the first one, a rotation and
a translation from the world to OpenCV's camera axes, and the photo's width, height and channels. Photos
under other lights (gt_…) are read apart.
https://github.com/isl-org/objects-with-lighting#dataset-format
"""

import re
from contextlib import suppress
from pathlib import Path

import numpy as np

from ..camera_folder import files_in, words_of
from ..fields import numbers, pose_of_world
from ..files import text_head
from ..intake import Capture, Found, Intrinsics, PhotoFinder, assemble
from ..pinhole import pinhole_of

NAME = "Objects with Lighting"
PATTERNS = tuple(f"{folder}camera_[0-9]*.txt" for folder in ("", "inputs/", "test/inputs/"))

_FILE = re.compile(r"(.*)camera_(\d+)\.txt")


def recognises(file: Path) -> bool:
    """True for eight lines of three numbers in a file that is called as such a camera's."""
    if _FILE.fullmatch(file.name) is not None:
        rows = [line.split() for line in text_head(file, 1 << 12).strip().splitlines()]
        with suppress(ValueError):
            return np.array(rows, dtype=float).shape == (8, 3)
    return False


def read(path: Path, photos: PhotoFinder) -> Capture:
    """Read all cameras of a file's folder whose names begin as the file's does."""
    kind = _FILE.fullmatch(path.name)[1]
    named = [(file, _FILE.fullmatch(file.name)) for file in files_in(path.parent, ".txt")]
    found = [_camera(file, *n.groups(), photos) for file, n in named if n and n[1] == kind]
    return assemble(path, NAME, found, photos)


def _camera(file: Path, kind: str, number: str, photos: PhotoFinder) -> Found:
    values = numbers(file, "K, R, t, size", words_of(file), 24)
    k, rotation = values[:18].reshape(2, 3, 3)
    pose = pose_of_world(file, "R, t", np.column_stack([rotation, values[18:21]]))
    stated, mask = f"{kind}image_{number}", file.with_name(f"{kind}mask_{number}.png")
    lens = Intrinsics(*map(int, values[21:23]), *pinhole_of(file, "K", k))
    photo, mask = photos.find_in(file.parent, stated), mask if mask.is_file() else None
    return Found(f"{file.name}, R", stated, photo, pose, lens, mask)
