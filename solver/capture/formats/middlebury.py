"""Cameras of Middlebury's multi-view data sets (temple, dino), and of all that are written in their form.

`NAME_par.txt` has the number of photos in its first line, and a line for each after it:

    temple0001.png k11 k12 k13 k21 … k33 r11 r12 r13 r21 … r33 t1 t2 t3

A photo's projection is K [R t], with OpenCV's axes, in pixels that are counted from the photo's upper left,
x across and y down. The photos' size is not stated; the lens's centre tells.
https://vision.middlebury.edu/mview/data (README.txt of each data set)
"""

from pathlib import Path

import numpy as np

from ..camera_folder import matrix_of
from ..errors import CaptureError, shown
from ..fields import pose_of_world
from ..files import CUT_OFF, read_lines, text_head
from ..intake import Capture, Found, PhotoFinder, assemble
from ..pinhole import lens_on, pinhole_of

NAME = "Middlebury"
PATTERNS = ("*_par.txt", "*/*_par.txt")

_NUMBERS = 21
"""of a line: a lens, a rotation and a translation"""


def recognises(file: Path) -> bool:
    """True for a number in a line of its own, before one with a name and 21 numbers."""
    first, *rest = text_head(file, 1 << 12).splitlines()[:3] or [b""]
    following = next((line for line in rest if line.strip()), b"")
    words = following.rsplit(maxsplit=_NUMBERS)
    try:
        return int(first) > 0 and len(words) > _NUMBERS and bool([float(word) for word in words[1:]])
    except ValueError:
        return False


def read(path: Path, photos: PhotoFinder) -> Capture:
    lines = [line for line in read_lines(path) if line[1]][1:]  # behind the count
    found = [_camera(path, *line, photos) for line in lines]
    return assemble(path, NAME, found, photos)


def _camera(path: Path, where: str, line: str, photos: PhotoFinder) -> Found:
    name, *words = line.rsplit(maxsplit=_NUMBERS)
    if len(words) != _NUMBERS:
        raise CaptureError(path, where, f"'{shown(line)}' is not a name with {_NUMBERS} numbers", CUT_OFF)
    lens, rotation = (matrix_of(path, where, words[at : at + 9], 3, 3) for at in (0, 9))
    translation = matrix_of(path, where, words[18:], 3, 1)
    where = f"{where}, {shown(name)}"
    pose = pose_of_world(path, where, np.hstack([rotation, translation]))
    photo = photos.find(name, beside=path)
    return Found(where, name, photo, pose, lens_on(photo, *pinhole_of(path, where, lens)))
