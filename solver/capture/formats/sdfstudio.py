"""SDFStudio's `meta_data.json`: frames with a photo, a lens's matrix and one from the camera to the world.

The camera's axes are OpenCV's; `intrinsics` is a matrix of 3 × 3 or 4 × 4 numbers for photos of `width` ×
`height`; `foreground_mask` names the mask. What is to be reconstructed is in `scene_box`.
https://github.com/autonomousvision/sdfstudio (sdfstudio_dataparser.py)
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..capture import Capture
from ..errors import CaptureError
from ..fields import entries, mapping, number, numbers
from ..files import json_head, read_json
from ..frames import pose_opengl_from_opencv
from ..image_header import image_size
from ..intake import Found, Intrinsics, assemble
from ..photo_finder import PhotoFinder
from ..pinhole import pinhole_of, size_meant

NAME = "SDFStudio meta_data.json"
EXTENSIONS = (".json",)
PATTERNS = ("meta_data.json", "*/meta_data.json")


def recognises(file: Path) -> bool:
    """True for JSON whose frames have SDFStudio's matrices, also if it is cut off."""
    head = json_head(file)
    return b'"frames"' in head and b'"camtoworld"' in head and b'"rgb_path"' in head


def read(path: Path, photos: PhotoFinder) -> Capture:
    """Read all frames; the scene's box becomes the region."""
    content = mapping(path, "", read_json(path))
    found = []
    for index, frame in enumerate(entries(path, "frames", content.get("frames"))):
        where = f"frames[{index}]"
        frame = mapping(path, where, frame)
        stated = frame.get("rgb_path")
        if not isinstance(stated, str) or not stated or "\0" in stated:
            raise CaptureError(
                path, f"{where}.rgb_path", "the frame names no photo", "add its path"
            )
        pose = _matrix(path, f"{where}.camtoworld", frame.get("camtoworld"), (3, 4))
        photo = photos.find(stated, beside=path)
        intrinsics = mask = None
        if photos.serves(photo):
            intrinsics = _intrinsics(path, where, content, frame, photo)
        if photo is not None:
            mask = photos.mask_of(photo, frame.get("foreground_mask"), beside=path)
        pose = pose_opengl_from_opencv(np.vstack([pose, (0, 0, 0, 1)]))
        found.append(Found(f"{where}.camtoworld", stated, photo, pose, intrinsics, mask))
    capture = assemble(path, NAME, found, photos)
    region = _region(path, content.get("scene_box"))
    return capture if region is None else replace(capture, region=region)


def _intrinsics(
    path: Path, where: str, content: dict, frame: dict, photo: Path | None
) -> Intrinsics:
    field = f"{where}.intrinsics"
    lens = pinhole_of(path, field, _matrix(path, field, frame.get("intrinsics"), (3, 3)))
    if content.get("width") is not None and content.get("height") is not None:
        width, height = (int(number(path, side, content[side])) for side in ("width", "height"))
    elif photo is not None:
        width, height = size_meant(image_size(photo), *lens[2:])
    else:
        raise CaptureError(path, "width", "the photos' size is missing", "add width and height")
    return Intrinsics(width, height, *lens)


def _matrix(path: Path, where: str, stated: Any, shape: tuple[int, int]) -> np.ndarray:
    """The upper left part [rows, columns] of a matrix that may have a row or a column more."""
    rows, columns = shape
    if isinstance(stated, list) and rows <= len(stated) <= 4:
        values = [numbers(path, where, row) for row in stated[:rows]]
        if all(columns <= len(row) <= 4 for row in values):
            return np.stack([row[:columns] for row in values])
    raise CaptureError(path, where, "this is not a matrix", "export the cameras again")


def _region(path: Path, stated: Any) -> np.ndarray | None:
    """The world box [2, 3] that the file states; None if it states none."""
    if not isinstance(stated, dict) or stated.get("aabb") is None:
        return None
    box = _matrix(path, "scene_box.aabb", stated["aabb"], (2, 3))
    if not (box[1] - box[0] > 1e-9).all():
        raise CaptureError(
            path, "scene_box.aabb", "the box has no size", "give its lowest and highest corner"
        )
    return box
