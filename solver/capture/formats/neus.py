"""Cameras of NeuS and IDR: `cameras_sphere.npz`, `cameras.npz`.

For photo i, in the order of their names, `world_mat_i` is the 4 × 4 projection K [R | t] of world to pixels
with OpenCV's axes, where whole numbers are pixels' centres; `scale_mat_i` takes the unit sphere to the
world, and what is to be reconstructed is in that sphere. Photos lie in `image` beside the file, masks in
`mask`, under the same numbers: IDR has image/000012.png and mask/012.png.
https://github.com/lioryariv/idr/blob/main/DATA_CONVENTION.md
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..files import head_of
from ..frames import pose_opengl_from_opencv
from ..in_order import photos_in_order
from ..intake import Capture, CaptureError, Found, PhotoFinder, assemble
from ..npy_files import read_npz
from ..picture_names import folder_called, pictures_in
from ..pinhole import lens_on, of_projection

NAME = "NeuS"
PATTERNS = ("cameras_sphere.npz", "cameras*.npz", "*/cameras_sphere.npz", "*/cameras*.npz")

_PHOTO_FOLDERS = ("image", "images", "rgb")


def recognises(file: Path) -> bool:
    head = head_of(file)
    return head.startswith(b"PK") and re.search(rb"(world|scale|camera)_mat_", head) is not None


def read(path: Path, photos: PhotoFinder) -> Capture:
    """Read the projections of all photos; the sphere becomes the region."""
    projections = _numbered(path, "world_mat_")
    if not projections:
        raise CaptureError(path, "world_mat_0", "there are no projections in it", "give cameras_sphere.npz")
    there = photos_in_order(path, "world_mat", len(projections), _PHOTO_FOLDERS, photos)
    pictures = pictures_in(folder_called(path.parent, "mask"))
    masks = {int(picture.stem): picture for picture in pictures if _is_number(picture.stem)}
    found = [
        _found(path, f"world_mat_{number}", projections[number], photo, masks)
        for number, photo in zip(sorted(projections), there, strict=True)
    ]
    capture = assemble(path, NAME, found, photos)
    spheres = _numbered(path, "scale_mat_")
    return replace(capture, region=_region(path, spheres)) if spheres else capture


def _numbered(path: Path, name: str) -> dict[int, np.ndarray]:
    """The matrices `name`0, `name`1, … by their numbers."""
    found = {}
    for key, matrix in read_npz(path, name).items():
        number = key.removeprefix(name)
        if not _is_number(number):
            continue  # world_mat_inv_0
        if matrix.shape not in ((4, 4), (3, 4)):
            raise CaptureError(path, key, "this is not a 4 × 4 matrix")
        found[int(number)] = matrix
    return found


def _is_number(name: str) -> bool:
    return name.isascii() and name.isdigit() and len(name) < 9


def _found(
    path: Path, where: str, projection: np.ndarray, photo: Path | None, masks: dict[int, Path]
) -> Found:
    if photo is None:
        return Found(where, where, None, None, None)
    (fx, fy, cx, cy), to_world = of_projection(path, where, projection[:3])
    intrinsics = lens_on(photo, fx, fy, cx + 0.5, cy + 0.5)
    mask = masks.get(int(photo.stem)) if _is_number(photo.stem) else None
    return Found(where, photo.name, photo, pose_opengl_from_opencv(to_world), intrinsics, mask)


def _region(path: Path, spheres: dict[int, np.ndarray]) -> np.ndarray:
    """World box [2, 3] around the sphere, which is the same for all photos."""
    number = min(spheres)
    matrix = spheres[number]
    radius = float(np.linalg.norm(matrix[:3, 0]))
    centre = matrix[:3, 3]
    if not (1e-9 < radius < 1e12 and np.abs(centre).max() < 1e12):
        raise CaptureError(path, f"scale_mat_{number}", "its sphere has no size")
    return np.stack([centre - radius, centre + radius])
