"""Captures of a box as tests check them: photos with chosen ones edited, or cameras alone."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image, ImageFilter

from solver.capture.capture import Capture
from solver.capture.formats.transforms import write_transforms
from solver.capture.read import read_capture
from tests.cameras.box_scene import box_camera, look_at

ROOT = Path(__file__).resolve().parents[2]


def around(count=24, heights=(0.9, 1.9), degrees=360.0, distance=2.6):
    """Poses on an arc around the box, at several heights in turn."""
    poses = []
    for i in range(count):
        angle = math.radians(degrees * i / count)
        position = np.array(
            [distance * math.cos(angle), distance * math.sin(angle), heights[i % len(heights)]]
        )
        poses.append(look_at(position, np.array([0.0, 0.0, 0.45])))
    return poses


def write(folder, pictures, edit=None, masked=True):
    """A capture of the pictures; `edit` may change them: (index, colour, mask) -> (colour, mask)."""
    cameras, shots = pictures
    named = []
    for index, (camera, (colour, mask)) in enumerate(zip(cameras, shots, strict=True)):
        if edit is not None:
            colour, mask = edit(index, colour, mask)
        if masked and mask is not None:
            colour = np.concatenate([colour, np.where(mask, 255, 0)[..., None]], -1).astype(np.uint8)
        path = folder / f"{camera.name}.png"
        Image.fromarray(colour).save(path)
        named.append(replace(camera, image_path=Path(path.name)))
    write_transforms(folder / "transforms_train.json", named)
    return read_capture(folder)


def only(**edits):
    """An edit of single pictures: {"at3": function of colour, mask}."""
    chosen = {int(key[2:]): function for key, function in edits.items()}
    return lambda i, colour, mask: chosen[i](colour, mask) if i in chosen else (colour, mask)


def blurred(radius):
    def edit(colour, mask):
        return np.asarray(Image.fromarray(colour).filter(ImageFilter.GaussianBlur(radius))), mask

    return edit


def warnings(found):
    return [finding for finding in found if finding.level == "warning"]


def capture_at(poses, **changes):
    cameras = tuple(replace(box_camera(p), name=f"c{i}", **changes) for i, p in enumerate(poses))
    return Capture(Path("t.json"), cameras, np.array([[-0.5] * 3, [0.5] * 3]) + [0, 0, 0.45])
