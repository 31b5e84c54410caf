"""Folders of poses: NSVF's, which svox2 and scene representation networks share, and others'.

    NSVF:    intrinsics.txt, pose/0_train_0000.txt …, rgb/0_train_0000.png …, bbox.txt
    ScanNet: intrinsic/intrinsic_color.txt, pose/0.txt …, color/0.jpg …
    NeRF++:  train/intrinsics/000.txt …, train/pose/000.txt …, train/rgb/000.png …
    FoundationPose: K.txt, cam_in_ob/000000.txt …, rgb/000000.png …
    BundleSDF: cam_K.txt, ob_in_cam/0.txt …, color_segmented/0.png …

A pose is a matrix from the camera to the world, with OpenCV's axes; NSVF also reads those from the world
to the camera, in a folder `extrinsic`, as those in `ob_in_cam` are. ScanNet's and objects' are in metres,
and −inf where the camera was lost. The lens is a matrix of 3 × 3 or 4 × 4 numbers, or `f cx cy` in
the first line, in pixels counted from the picture's corner, or, of objects, from the middle of the first
one; for photos of which size is not stated. NeRF++ has a lens for each photo, and all numbers of a matrix
in one line. Where names begin with 0_, 1_ or 2_, photos are for training, validation and tests: only the
first are read. `bbox.txt` has the lowest and the highest x y z of what is to be reconstructed, and a
voxel's size.
https://github.com/facebookresearch/NSVF#dataset (data_utils.py, shape_dataset.py) and its issue 64;
https://github.com/sxyu/svox2 (nsvf_dataset.py); https://github.com/ScanNet/ScanNet (SensorData.py);
https://github.com/Kai-46/nerfplusplus#data; https://github.com/NVlabs/FoundationPose
(bundlesdf/run_nerf.py: `run_one_ob`), https://github.com/NVlabs/BundleSDF (bundlesdf.py)
"""

import math
import re
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..camera_folder import files_in, matrix_of, photo_folder, rows_of, words_of
from ..errors import CaptureError, counted
from ..fields import is_no_pose, rigid_pose
from ..files import text_head
from ..frames import invert_pose, pose_opengl_from_opencv
from ..intake import Capture, Found, PhotoFinder, assemble
from ..pinhole import lens_on, pinhole_of

NAME = "NSVF, ScanNet, NeRF++, FoundationPose"
_OF_ALL = ("intrinsics.txt", "intrinsic.txt", "intrinsic/intrinsic_color.txt", "K.txt", "cam_K.txt")
_OF_EACH = "intrinsics"
PATTERNS = (*_OF_ALL, f"{_OF_EACH}/*.txt", f"train/{_OF_EACH}/*.txt")

_FROM_WORLD = ("extrinsic", "ob_in_cam")
_POSE_FOLDERS = ("pose", "poses", "cam_in_ob", *_FROM_WORLD)
_PHOTO_FOLDERS = ("rgb", "color", "images", "image", "color_segmented")
_BOX = "bbox.txt"
_SPLIT = re.compile(r"[012]_.")
_TRAINING = "0_"


def recognises(file: Path) -> bool:
    """True for the lens or any pose of such a folder, if it begins with a number."""
    if _lens_file(file) is None:
        return False
    with suppress(ValueError, IndexError):
        return float(text_head(file).split()[0]) is not None
    return False


def read(path: Path, photos: PhotoFinder) -> Capture:
    """Read lenses and all poses that are not of photos held out; the box becomes the region."""
    lens_file = _lens_file(path)
    place = next(folder for folder in lens_file.parents if _pose_folder(folder) is not None)
    has_each, is_scannet = lens_file.parent.name == _OF_EACH, lens_file.parent.name == "intrinsic"
    of_object = lens_file.stem in ("K", "cam_K")
    middle = np.array((0, 0, 0.5, 0.5)) * of_object
    of_all = None if has_each else _lens(lens_file)
    files = files_in(_pose_folder(place), ".txt")
    used = _of_training(files)
    folder = photo_folder(place, _PHOTO_FOLDERS)
    found, lost = [], []
    for file in used:
        stated, photo = f"{folder.name}/{file.stem}", photos.find_in(folder, file.stem)
        pose = _pose(file)
        if is_no_pose(pose):
            lost.append(stated)
            continue
        if file.parent.name in _FROM_WORLD:
            pose = invert_pose(rigid_pose(file, "", pose))
        lens = _lens(lens_file.with_name(file.name)) if has_each else of_all
        where, pose = f"{file.parent.name}/{file.name}", pose_opengl_from_opencv(pose)
        found.append(Found(where, stated, photo, pose, lens_on(photo, *np.add(lens, middle))))
    lost, warnings = (lost, "poses"), ()
    if len(used) < len(files):
        what = f"{len(files) - len(used)} photo|photos for validation and tests (1_…, 2_…) is|are left out"
        warnings = (f"{place.name}: {counted(what)}",)
    name = "NeRF++" if has_each else "ScanNet" if is_scannet else "FoundationPose" if of_object else "NSVF"
    metric = is_scannet or of_object
    capture = assemble(lens_file, name, found, photos, metric=metric, warnings=warnings, lost=lost)
    return _within_box(capture, place / _BOX)


def _pose_folder(place: Path) -> Path | None:
    return next((place / name for name in _POSE_FOLDERS if (place / name).is_dir()), None)


def _lens_file(file: Path) -> Path | None:
    """The file of the lens, if `file` is that or one of the poses; else None."""
    file = file.absolute()
    for place in list(file.parents)[:2]:
        poses = _pose_folder(place)
        lens_files = [place / name for name in _OF_ALL]
        if poses is None or not (file in lens_files or file.parent in (poses, place / _OF_EACH)):
            continue
        lens_files.append(place / _OF_EACH / f"{file.stem}.txt")
        return next((lens_file for lens_file in lens_files if lens_file.is_file()), None)
    return None


def _lens(path: Path) -> tuple[float, float, float, float]:
    """fx fy cx cy of a lens's file, in pixels."""
    rows = rows_of(path)
    lengths = [len(row) for row in rows]
    if lengths in ([9], [16]):  # a matrix in one line
        side = math.isqrt(lengths[0])
        rows = [rows[0][at : at + side] for at in range(0, len(rows[0]), side)]
        lengths = [side] * side
    if lengths in ([3] * 3, [4] * 3, [4] * 4):
        words = [word for row in rows[:3] for word in row[:3]]
    elif lengths and lengths[0] in (3, 4):
        f, cx, cy = rows[0][:3]
        words = [f, "0", cx, "0", f, cy, "0", "0", "1"]
    else:
        raise CaptureError(path, "", "this is neither a lens's matrix nor a line f cx cy")
    return pinhole_of(path, "", matrix_of(path, "", words, 3, 3))


def _pose(path: Path) -> np.ndarray:
    """A matrix [4, 4] or [3, 4], which may be none that a camera can have."""
    words = words_of(path)
    return matrix_of(path, "", words, 3 if len(words) == 12 else 4, 4)


def _of_training(files: list[Path]) -> list[Path]:
    """Those files whose names say that they are for training; all, where names say nothing."""
    training = [file for file in files if file.name.startswith(_TRAINING)]
    return training if training and all(_SPLIT.match(file.stem) for file in files) else files


def _within_box(capture: Capture, path: Path) -> Capture:
    """The capture with the box of a file as its region, if there is one that its cameras look at."""
    if not path.is_file():
        return capture
    with suppress(CaptureError):
        box = matrix_of(path, "", words_of(path)[:6], 2, 3)
        low, high = capture.region
        if (box[0] < box[1]).all() and (box[0] < high).all() and (box[1] > low).all():
            if np.abs(box).max() < 1e12:
                return replace(capture, region=box)
    problem = f"{path.name}: this is not a box that the cameras look at; it is not used"
    return replace(capture, warnings=(*capture.warnings, problem))
