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
from typing import Any

import numpy as np

from ..capture import Capture
from ..errors import CaptureError, shown
from ..fields import mapping, number, numbers, rigid_pose
from ..files import json_head, read_json
from ..frames import invert_pose, pose_opengl_from_opencv
from ..intake import Found, Intrinsics, assemble, without_pose
from ..photo_finder import PhotoFinder
from ..picture_names import parts_of

NAME = "NeILF sfm_scene.json"
EXTENSIONS = (".json",)
PATTERNS = ("sfm_scene.json", "inputs/sfm_scene.json", "*/inputs/sfm_scene.json")

_KNOWN = 2
"""`flg` of a camera that was found"""


def recognises(file: Path) -> bool:
    """True for JSON with NeILF's cameras, or called as its file and begun as JSON is."""
    head = json_head(file)
    return b'"camera_track_map"' in head or (bool(head) and file.name.lower() == "sfm_scene.json")


def read(path: Path, photos: PhotoFinder) -> Capture:
    """Read all cameras that are known; the box becomes the region."""
    content = mapping(path, "", read_json(path))
    names = _inside(path, content, "image_path", "file_paths")
    cameras = _inside(path, content, "camera_track_map", "images")
    found, lost = [], []
    for index, camera in cameras.items():
        where = f"camera_track_map.images.{shown(index)}"
        camera, stated = mapping(path, where, camera), names.get(index)
        if not isinstance(stated, str) or not stated or "\0" in stated:
            raise CaptureError(
                path, f"image_path.file_paths.{shown(index)}", "the camera has no photo",
                "add the photo's path",
            )  # fmt: skip
        if camera.get("flg") != _KNOWN:
            lost.append(stated)
            continue
        found.append(_camera(path, where, camera, stated, photos))
    warnings = without_pose(path, "flg", lost, len(cameras), "solve or export the cameras again")
    capture = assemble(path, NAME, found, photos, warnings=warnings)
    return _within_box(path, capture, content.get("bbox"))


def _inside(path: Path, content: dict, *keys: str) -> dict:
    """The object at nested keys."""
    for depth, key in enumerate(keys, 1):
        content = mapping(path, ".".join(keys[:depth]), content.get(key))
    return content


def _camera(path: Path, where: str, camera: dict, stated: str, photos: PhotoFinder) -> Found:
    inner = mapping(path, f"{where}.camera", camera.get("camera"))
    field = f"{where}.camera.extrinsic"
    extrinsic = _matrix(path, field, inner.get("extrinsic"))
    pose = pose_opengl_from_opencv(invert_pose(rigid_pose(path, field, extrinsic)))
    # Only the name counts: the photos lie in this folder, and maps of the same names in others.
    folder, name = path.parent / "images", parts_of(stated)[-1:]
    photo = photos.find_in(folder, *name) if name and folder.is_dir() else None
    photo, intrinsics = photo or photos.find(stated, beside=path), None
    if photos.serves(photo):
        lens = mapping(path, f"{where}.camera.intrinsic", inner.get("intrinsic"))
        size, focal, centre = (
            numbers(path, f"{where}.{name}", value, 2).tolist()
            for name, value in (
                ("size", camera.get("size")), ("camera.intrinsic.focal", lens.get("focal")),
                ("camera.intrinsic.ppt", lens.get("ppt")),
            )
        )  # fmt: skip
        intrinsics = Intrinsics(*map(int, size), *focal, *centre)
    return Found(field, stated, photo, pose, intrinsics)


def _matrix(path: Path, field: str, values: Any) -> np.ndarray:
    """A matrix [4, 4] of 16 numbers, in a list or in lists of its rows."""
    flat = np.ravel(np.array(values, dtype=object)).tolist()
    return numbers(path, field, flat, 16).reshape(4, 4)


def _within_box(path: Path, capture: Capture, box: Any) -> Capture:
    """The capture with the cube as its region, if the file has an upright box."""
    if box is None:
        return capture
    field = "bbox.transform"
    matrix = _matrix(path, field, mapping(path, "bbox", box).get("transform"))
    sides = np.diag(matrix)[:3]
    turned = np.abs(matrix[:3, :3] - np.diag(sides)).max() > 1e-6 * np.abs(sides).max()
    half = number(path, field, float(sides.max())) / 2
    if turned or not 1e-9 < half < 1e12 or np.abs(matrix[:3, 3]).max() > 1e12:
        problem = f"{path.name}: {field} is not an upright box; it is not used"
        return replace(capture, warnings=(*capture.warnings, problem))
    return replace(capture, region=np.stack([matrix[:3, 3] - half, matrix[:3, 3] + half]))
