"""SDFStudio's `meta_data.json`: frames with a photo, a lens's matrix and one from the camera to the world.

The camera's axes are OpenCV's; `intrinsics` is a matrix of 3 × 3 or 4 × 4 numbers for photos of `width` ×
`height`; `foreground_mask` names the mask. What is to be reconstructed is in `scene_box`.
https://github.com/autonomousvision/sdfstudio (sdfstudio_dataparser.py)
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from ..fields import Entry
from ..files import json_holds
from ..frames import pose_opengl_from_opencv
from ..intake import Capture, Found, Intrinsics, PhotoFinder, assemble
from ..pinhole import lens_on, pinhole_of

NAME = "SDFStudio meta_data.json"
PATTERNS = ("meta_data.json", "*/meta_data.json")


def recognises(file: Path) -> bool:
    return json_holds(file, "frames", "camtoworld", "rgb_path")


def read(path: Path, photos: PhotoFinder) -> Capture:
    """Read all frames; the scene's box becomes the region."""
    content = Entry.of_file(path)
    found = []
    for frame in content.objects("frames"):
        stated = frame.name("rgb_path", "the frame names no photo", "add its path")
        pose = frame.matrix("camtoworld", (3, 4))
        photo = photos.find(stated, beside=path)
        intrinsics = mask = None
        if photos.serves(photo):
            intrinsics = _intrinsics(content, frame, photo)
        if photo is not None:
            mask = photos.mask_of(photo, frame.get("foreground_mask"), beside=path)
        pose = pose_opengl_from_opencv(np.vstack([pose, (0, 0, 0, 1)]))
        found.append(Found(frame.field("camtoworld"), stated, photo, pose, intrinsics, mask))
    capture = assemble(path, NAME, found, photos)
    region = _region(content)
    return capture if region is None else replace(capture, region=region)


def _intrinsics(content: Entry, frame: Entry, photo: Path | None) -> Intrinsics:
    matrix = frame.matrix("intrinsics", (3, 3))
    lens = pinhole_of(frame.path, frame.field("intrinsics"), matrix)
    if content.get("width") is not None and content.get("height") is not None:
        return Intrinsics(int(content.number("width")), int(content.number("height")), *lens)
    if photo is None:
        raise content.error("width", "the photos' size is missing", "add width and height")
    return lens_on(photo, *lens)


def _region(content: Entry) -> np.ndarray | None:
    stated = content.get("scene_box")
    if not isinstance(stated, dict) or stated.get("aabb") is None:
        return None
    stated = content.inner("scene_box")
    box = stated.matrix("aabb", (2, 3))
    if not (box[1] - box[0] > 1e-9).all():
        raise stated.error("aabb", "the box has no size", "give its lowest and highest corner")
    return box
