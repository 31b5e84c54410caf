"""Cameras of NeRO's glossy synthetic objects, and of all that are rendered in their layout.

    0-camera.pkl, 0.png, 0-depth.png, 1-camera.pkl, …

A pickled list of two arrays: a 3 × 4 matrix from the world to the camera, with OpenCV's axes, and the 3 × 3
matrix of the lens, in pixels of the photo of the same number. Any one of the files stands for all of its
folder; depths are of no use here.
https://github.com/liuyuan-pal/NeRO, `GlossySyntheticDatabase` of dataset/database.py
"""

import re
from pathlib import Path

from ..camera_folder import LARGEST_FILE, files_in
from ..fields import is_no_pose, pose_of_world
from ..files import head_of
from ..intake import Capture, CaptureError, Found, PhotoFinder, assemble
from ..pickled import matrices_in
from ..pinhole import lens_on, pinhole_of

NAME = "NeRO"
_ENDING = "-camera.pkl"
PATTERNS = (f"[0-9]*{_ENDING}",)

_FILE = re.compile(rf"(\d+){re.escape(_ENDING)}")
_PICKLED = b"\x80"


def recognises(file: Path) -> bool:
    return _FILE.fullmatch(file.name) is not None and head_of(file, 1) == _PICKLED


def read(path: Path, photos: PhotoFinder) -> Capture:
    folder = path.absolute().parent
    files = [file for file in files_in(folder, _ENDING) if _FILE.fullmatch(file.name)]
    cameras = [_camera(file, photos) for file in files]
    found = [camera for camera in cameras if camera.camera_to_world is not None]
    lost = [camera.stated for camera in cameras if camera.camera_to_world is None]
    return assemble(path, NAME, found, photos, lost=(lost, "pose"))


def _camera(file: Path, photos: PhotoFinder) -> Found:
    matrices = matrices_in(file, LARGEST_FILE)
    if len(matrices) != 2 or matrices[0].shape not in ((3, 4), (4, 4)) or matrices[1].shape != (3, 3):
        raise CaptureError(file, "", "this is not a pickled pair of a pose (3 × 4) and a lens (3 × 3)")
    number = _FILE.fullmatch(file.name)[1]
    photo = photos.find_in(file.parent, number)
    pose = intrinsics = None
    if not is_no_pose(matrices[0]):
        pose = pose_of_world(file, "pose", matrices[0])
        intrinsics = lens_on(photo, *pinhole_of(file, "lens", matrices[1]))
    return Found(f"{file.name}, pose", number, photo, pose, intrinsics)
