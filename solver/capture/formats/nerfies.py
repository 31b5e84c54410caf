"""Captures of Nerfies, which HyperNeRF and DyCheck share: `camera/ID.json` beside `rgb/1x/ID.png`.

A file has the rotation from the world to OpenCV's camera axes, the camera's place, and OpenCV's lens:
focal length, `pixel_aspect_ratio` (of fy to fx), `skew` (what a unit of y adds, in pixels), radial and
tangential distortion, in pixels of a photo of `image_size` counted from its corner. Photos made smaller
lie in `2x`, `4x` and so on. `dataset.json` tells photos for training from those for validation, which are
left out; `points.npy` has points of the surroundings. All is in the world before `scene.json` scales it.

What moves between the photos, as these captures were made to show, is not reconstructed.
https://github.com/google/nerfies#datasets and its camera.py
"""

from pathlib import Path

import numpy as np

from ..brown_lens import polynomial_lens
from ..camera_folder import files_in
from ..errors import CaptureError, counted
from ..fields import Entry, numbers
from ..files import json_holds
from ..frames import pose_opengl_from_opencv, rigid
from ..intake import Capture, Found, Intrinsics, PhotoFinder, assemble
from ..npy_files import read_npy
from ..picture_names import numbered, pictures_in

NAME = "Nerfies"
PATTERNS = ("camera/*.json", "*/camera/*.json")

_PHOTOS = "rgb"


def recognises(file: Path) -> bool:
    return json_holds(file, "orientation", "position", "focal_length", "radial_distortion", count=1 << 16)


def read(path: Path, photos: PhotoFinder) -> Capture:
    """Read all cameras for training of the folder that a camera's JSON file lies in."""
    place = path.absolute().parent.parent
    scales = sorted((place / _PHOTOS).glob("*x"), key=lambda folder: numbered(folder.name))
    folder = next(filter(pictures_in, scales), place / _PHOTOS / "1x")
    files = files_in(path.parent, ".json")
    used = _of_training(place / "dataset.json", files)
    found = [_camera(file, folder, photos) for file in used]
    warnings = ()
    if len(used) < len(files):
        others = f"{len(files) - len(used)} photo|photos for validation"
        warnings = (counted(f"{others} is|are left out (dataset.json)"),)
    points, problems = _points(place / "points.npy")
    return assemble(path, NAME, found, photos, points=points, warnings=warnings + problems)


def _of_training(path: Path, files: list[Path]) -> list[Path]:
    """Those cameras that a list of the data set has for training; all, where there is no such list."""
    if not path.is_file():
        return files
    listed = Entry.of_file(path).entries("train_ids")
    wanted = {name for name in listed if isinstance(name, str)}
    return [file for file in files if file.stem in wanted] or files


def _camera(file: Path, folder: Path, photos: PhotoFinder) -> Found:
    content = Entry.of_file(file)
    rotation = np.zeros((3, 3))
    for row, values in enumerate(content.entries("orientation")[:3]):
        rotation[row] = numbers(file, f"orientation[{row}]", values, 3)
    pose = rigid(rotation.T, content.numbers("position", 3))
    photo = photos.find_in(folder, f"{file.stem}.png")
    intrinsics = _intrinsics(content) if photos.serves(photo) else None
    stated = f"{_PHOTOS}/{folder.name}/{file.stem}"
    return Found(f"{file.name}, orientation", stated, photo, pose_opengl_from_opencv(pose), intrinsics)


def _intrinsics(content: Entry) -> Intrinsics:
    focal = content.number("focal_length")
    if focal <= 0:
        raise content.error("focal_length", "it is not positive")
    width, height = content.numbers("image_size", 2)
    cx, cy = content.numbers("principal_point", 2)
    radial = content.numbers("radial_distortion", 3)
    key = "tangential" if "tangential" in content else "tangential_distortion"
    tangential = content.numbers(key, 2)
    skew = content.optional("skew", 0.0) / focal
    lens, distortion = polynomial_lens(radial, tangential, skew)
    fy = focal * content.optional("pixel_aspect_ratio", 1.0)
    return Intrinsics(int(width), int(height), focal, fy, float(cx), float(cy), lens, distortion)


def _points(path: Path) -> tuple[np.ndarray | None, tuple[str, ...]]:
    """Points [N, 3] of the surroundings, and what is to be said about their file."""
    if not path.is_file():
        return None, ()
    try:
        points = read_npy(path)
    except CaptureError as error:
        return None, (str(error),)  # a fit does without them
    if points.ndim != 2 or points.shape[1] != 3:
        return None, (f"{path.name}: these are not points; they are not used",)
    return points, ()
