"""Cameras of DTU's multi-view data set as its makers publish it.

    Calibration/cal18/pos_001.txt … pos_064.txt     for the photos of all scans
    Rectified/scan1/rect_001_3_r5000.png …          or Cleaned/scan1/clean_001_3_r5000.png …

A file is the projection P = K [R | t] of one place of the robot that held the camera, three lines of
four numbers: from the world, in millimetres, to pixels of photos of 1600 × 1200, with OpenCV's axes. Whole
numbers are pixels' centres, as IDR and those after it count them with these very matrices. Photos are
counted as the matrices are, from 1; at each place there is one for each of seven lights, and one with all
of them (`rect_001_max.png`). Those of light 3, the most diffuse, are taken if they are there, as most do,
then those of all lights. A scan has photos of 49 or of 64 places. Any one of the files stands for all of
its folder.

Cameras for networks, in MVSNet's layout, are `mvsnet`'s.
https://roboimagedata.compute.dtu.dk (MVS data set); MVSNet's cameras for it, which are these decomposed;
https://github.com/lioryariv/idr (DATA_CONVENTION.md), whose `world_mat` are these
"""

import re
from pathlib import Path

import numpy as np

from ..camera_folder import files_in, matrix_of, words_of
from ..files import text_head
from ..frames import pose_opengl_from_opencv
from ..intake import Capture, Found, Intrinsics, PhotoFinder, assemble
from ..pinhole import FEWEST_PIXELS, of_projection

NAME = "DTU"
PATTERNS = tuple(
    f"{folder}pos_*.txt" for folder in ("", "cal18/", "[Cc]alibration/cal18/", "*/Calibration/cal18/")
)

_NUMBERED = re.compile(r"(.*?)([0-9]{1,6})")
_SIZE = 1600, 1200
"""width and height of the photos, which no file states"""
_PHOTOS = tuple(
    f"{kind}_{{:03d}}_{light}"
    for light in ("3_r5000", "max", *(f"{other}_r5000" for other in (0, 1, 2, 4, 5, 6)))
    for kind in ("rect", "clean")
)
"""what photos are called by their numbers, those that are taken first before others"""
_LONGEST = 1 << 12
"""bytes; twelve numbers are a tenth of that"""


def recognises(file: Path) -> bool:
    """True for text of three lines of four numbers that are a projection to pixels, in a file whose name
    ends in a number."""
    if _NUMBERED.fullmatch(file.stem) is None:
        return False
    rows = [words for line in text_head(file, _LONGEST).splitlines() if (words := line.split())]
    try:
        matrix = np.array([[float(word) for word in row] for row in rows])
    except ValueError:
        return False
    if matrix.shape != (3, 4):
        return False
    with np.errstate(all="ignore"):
        across, _, ahead = np.linalg.norm(matrix[:, :3], axis=1)
    return bool(across > FEWEST_PIXELS * ahead > 0)


def read(path: Path, photos: PhotoFinder) -> Capture:
    kind = _NUMBERED.fullmatch(path.stem)[1]
    files = {}
    for file in files_in(path.parent, path.suffix):
        parts = _NUMBERED.fullmatch(file.stem)
        if parts is not None and parts[1] == kind:
            files[int(parts[2])] = file
    called, there = _photos(list(files), photos)
    found = [_camera(file, called.format(number), there.get(number)) for number, file in files.items()]
    # The robot was at more places for some scans than for others, so that a photo is not there is no fault.
    of_use = [camera for camera in found if photos.serves(camera.photo)]
    return assemble(path, NAME, of_use if len(of_use) >= photos.fewest else found, photos)


def _photos(numbers: list[int], photos: PhotoFinder) -> tuple[str, dict[int, Path]]:
    """What the photos are called that are taken, and those that are there by their numbers.

    All are of one light: of the first that half of the places have photos of, else of that with the most.
    """
    best: tuple[str, dict[int, Path]] = (_PHOTOS[0], {})
    for called in _PHOTOS:
        named = ((number, photos.find(called.format(number))) for number in numbers)
        there = {number: photo for number, photo in named if photo is not None}
        if len(there) > len(best[1]):
            best = called, there
        if 2 * len(there) >= len(numbers):
            break
    return best


def _camera(file: Path, stated: str, photo: Path | None) -> Found:
    matrix = matrix_of(file, "", words_of(file), 3, 4)
    (fx, fy, cx, cy), to_world = of_projection(file, "", matrix)
    intrinsics = Intrinsics(*_SIZE, fx, fy, cx + 0.5, cy + 0.5)
    return Found(file.name, stated, photo, pose_opengl_from_opencv(to_world), intrinsics)
