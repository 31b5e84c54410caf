"""NeILF's `sfm_scene.json`, beside `images` in a folder `inputs`.

For each photo `camera_track_map.images` has, by its number, a matrix `extrinsic` from the world to the
camera, with OpenCV's axes, and `focal` and `ppt` in pixels counted from the corner of the first one, for a
photo of `size`; `flg` is 2 where the camera is known. `image_path.file_paths` has the photos' names by the
same numbers. The cube around the middle of `bbox.transform`, as large as its longest side, is what is to be
reconstructed.
https://github.com/apple/ml-neilf (code/utils/io.py: `load_cams_from_sfmscene`; geometry.py:
`depth_map_to_position_map`)
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from ..fields import Entry, number, numbers, pose_of_world
from ..files import json_head
from ..intake import Capture, Found, Intrinsics, PhotoFinder, assemble
from ..picture_names import parts_of

NAME = "NeILF sfm_scene.json"
PATTERNS = ("sfm_scene.json", "inputs/sfm_scene.json", "*/inputs/sfm_scene.json")

_KNOWN = 2
"""`flg` of a camera that was found"""


def recognises(file: Path) -> bool:
    """True for JSON with NeILF's cameras, or called as its file and begun as JSON is."""
    head = json_head(file)
    return b'"camera_track_map"' in head or (bool(head) and file.name.lower() == "sfm_scene.json")


def read(path: Path, photos: PhotoFinder) -> Capture:
    """Read all cameras that are known; the box becomes the region."""
    content = Entry.of_file(path)
    names = content.inner("image_path").inner("file_paths")
    cameras = content.inner("camera_track_map").inner("images")
    found, lost = [], []
    for index in cameras:
        camera = cameras.inner(index)
        stated = names.name(index, "the camera has no photo", "add the photo's path")
        if camera.get("flg") != _KNOWN:
            lost.append(stated)
            continue
        found.append(_camera(camera, stated, photos))
    lost = lost, "flg"
    return _within_box(content, assemble(path, NAME, found, photos, lost=lost))


def _camera(camera: Entry, stated: str, photos: PhotoFinder) -> Found:
    path, inner = camera.path, camera.inner("camera")
    field, extrinsic = inner.field("extrinsic"), _matrix(inner, "extrinsic")
    pose = pose_of_world(path, field, extrinsic)
    # Only the name counts: the photos lie in this folder, and maps of the same names in others.
    folder, name = path.parent / "images", parts_of(stated)[-1:]
    photo = photos.find_in(folder, *name) if name and folder.is_dir() else None
    photo, intrinsics = photo or photos.find(stated, beside=path), None
    if photos.serves(photo):
        lens = inner.inner("intrinsic")
        width, height = map(int, camera.numbers("size", 2))
        focal, centre = (lens.numbers(key, 2).tolist() for key in ("focal", "ppt"))
        intrinsics = Intrinsics(width, height, *focal, *centre)
    return Found(field, stated, photo, pose, intrinsics)


def _matrix(entry: Entry, key: str) -> np.ndarray:
    """A matrix [4, 4] of 16 numbers, in a list or in lists of its rows."""
    flat = np.ravel(np.array(entry.get(key), dtype=object)).tolist()
    return numbers(entry.path, entry.field(key), flat, 16).reshape(4, 4)


def _within_box(content: Entry, capture: Capture) -> Capture:
    """The capture with the cube as its region, if the file has an upright box."""
    if content.get("bbox") is None:
        return capture
    path, field = content.path, "bbox.transform"
    matrix = _matrix(content.inner("bbox"), "transform")
    sides = np.diag(matrix)[:3]
    turned = np.abs(matrix[:3, :3] - np.diag(sides)).max() > 1e-6 * np.abs(sides).max()
    half = number(path, field, float(sides.max())) / 2
    if turned or not 1e-9 < half < 1e12 or np.abs(matrix[:3, 3]).max() > 1e12:
        problem = f"{path.name}: {field} is not an upright box; it is not used"
        return replace(capture, warnings=(*capture.warnings, problem))
    return replace(capture, region=np.stack([matrix[:3, 3] - half, matrix[:3, 3] + half]))
