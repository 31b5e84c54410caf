"""LLFF's `poses_bounds.npy`: forward-facing captures, and those around an object that NeRF took over.

One row of 17 numbers a photo, photos in the order of their names: 3 × 5 numbers, row by row, of which the
columns are the camera's axes in the world (down, right, backwards), its place, and the photo's
height, width and focal length in pixels; then the depths of the nearest and farthest point.
The lens is a pinhole, its axis in the photo's centre: LLFF drops what COLMAP found beyond that.
https://github.com/Fyusion/LLFF#using-your-own-poses-without-running-colmap
"""

from pathlib import Path

import numpy as np

from ..files import head_of
from ..in_order import photos_in_order
from ..intake import Capture, CaptureError, Found, Intrinsics, PhotoFinder, assemble
from ..npy_files import MAGIC, read_npy

NAME = "LLFF"
PATTERNS = ("poses_bounds.npy", "*/poses_bounds.npy")

_PHOTO_FOLDERS = ("images", "rgb", "image", "images_2", "images_4", "images_8")


def recognises(file: Path) -> bool:
    """True for an array of 17 columns in numpy's format."""
    head = head_of(file, 256)
    return head.startswith(MAGIC) and b", 17)" in head


def read(path: Path, photos: PhotoFinder) -> Capture:
    table = read_npy(path)
    if table.ndim != 2 or table.shape[1] != 17:
        raise CaptureError(path, "", "this is not a table of 17 columns", "give LLFF's poses_bounds.npy")
    there = photos_in_order(path, "rows", len(table), _PHOTO_FOLDERS, photos)
    found = []
    for index, (row, photo) in enumerate(zip(table, there, strict=True)):
        matrix = row[:15].reshape(3, 5)
        down, right, backwards, place, (height, width, focal) = matrix.T
        pose = np.column_stack([right, -down, backwards, place])
        where = f"row {index}"
        found.append(
            Found(
                where, f"photo {index}" if photo is None else photo.name, photo, pose,
                Intrinsics(int(width), int(height), focal, focal, width / 2, height / 2),
            )
        )  # fmt: skip
    warnings = (
        f"{path.name}: it has no lens distortion; if there is COLMAP's model (sparse/0), give that instead",
    )
    return assemble(path, NAME, found, photos, warnings=warnings)
