"""Cameras by their photos' names: PhySG's and IRON's `cam_dict_norm.json`, NeRF++'s `kai_cameras.json`.

For each photo's name `K` and `W2C`, 16 numbers each, are a lens's matrix, in pixels counted from the corner
of the first one of a photo of `img_size`, and one from the world to the camera, with OpenCV's axes. Photos
lie in `image`, `images` or `rgb` beside the file.
https://github.com/Kai-46/nerfplusplus (colmap_runner/extract_sfm.py)
"""

from pathlib import Path

from ..camera_folder import photo_folder
from ..fields import Entry, pose_of_world
from ..files import json_holds
from ..intake import Capture, Found, Intrinsics, PhotoFinder, assemble
from ..pinhole import pinhole_of

NAME = "PhySG cam_dict_norm.json"
PATTERNS = tuple(
    f"{folder}{name}"
    for folder in ("", "train/", "posed_images/")
    for name in ("cam_dict_norm.json", "cam_dict.json", "kai_cameras_normalized.json", "kai_cameras.json")
)


def recognises(file: Path) -> bool:
    return json_holds(file, "W2C", "K")


def read(path: Path, photos: PhotoFinder) -> Capture:
    content, folder = Entry.of_file(path), photo_folder(path.parent, ("image", "images", "rgb"))
    return assemble(path, NAME, [_camera(content, name, folder, photos) for name in content], photos)


def _camera(content: Entry, name: str, folder: Path, photos: PhotoFinder) -> Found:
    path, entry, photo = content.path, content.inner(name), photos.find_in(folder, name)
    k, from_world = (entry.numbers(key, 16).reshape(4, 4) for key in ("K", "W2C"))
    pose = pose_of_world(path, entry.field("W2C"), from_world)
    width, height = map(int, entry.numbers("img_size", 2))
    lens = pinhole_of(path, entry.field("K"), k[:3, :3])
    return Found(entry.field("W2C"), name, photo, pose, Intrinsics(width, height, *lens))
