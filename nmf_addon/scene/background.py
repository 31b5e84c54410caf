"""Upright, undistorted copies of photos: what a camera without a lens would have seen, for Blender.

Blender's cameras have no distortion, and its images no EXIF orientation. The solver works on the
photos as they are; these copies only stand behind the scene, so they are small and live in the .blend.
"""

from dataclasses import replace
from functools import lru_cache

import bpy
import numpy as np
from bpy.types import Image

from ...solver.capture.camera import Camera
from ...solver.capture.image_header import image_orientation, image_size
from ...solver.capture.orientation import oriented, turn_for
from .cameras import UNDISTORTED
from .colour import set_colour_space

WIDEST = 800  # pixels


def is_distorted(camera: Camera) -> bool:
    """True if straight lines are not straight in the photo."""
    return camera.lens != "pinhole" and (camera.lens != "opencv" or any(camera.distortion))


def turn_of(camera: Camera) -> int:
    """The EXIF orientation by which the photo's file becomes what the camera saw; 1 if as it lies."""
    size, tag = image_size(camera.image_path), image_orientation(camera.image_path)
    return turn_for(size, tag, camera.width, camera.height) or 1


def empty_copy(name: str) -> Image:
    """An image that `fill_copy` is to fill, of the photo of a camera of that name."""
    copy = bpy.data.images.new(f"{name} undistorted", 1, 1, alpha=True)
    copy[UNDISTORTED] = True
    return copy


def fill_copy(copy: Image, camera: Camera, photo: Image, turn: int | None = None) -> None:
    """Let an empty copy show `photo` through a pinhole, with at most `WIDEST` pixels, and pack it.

    What the lens does not reach is transparent.

    Args:
        turn: the orientation by which `photo` becomes what the camera saw; None: it is the photo's file.

    Raises:
        RuntimeError: Blender cannot read the photo.
    """
    width, height = photo.size
    if not width or not height:
        raise RuntimeError(f"{photo.name}: Blender cannot read it")
    shrink = max(width, height) / WIDEST
    size = tuple(max(1, round(side / max(shrink, 1.0))) for side in (camera.width, camera.height))
    copy.use_generated_float = photo.is_float
    copy.generated_width, copy.generated_height = size
    if photo.is_float:
        # Of those, such as PNG of 16 bits, Blender gives linear light whatever their file holds.
        set_colour_space(copy, "Linear Rec.709")
    else:
        copy.colorspace_settings.name = photo.colorspace_settings.name
    was_loaded = photo.has_data
    source = np.empty(width * height * photo.channels, dtype=np.float32)
    photo.pixels.foreach_get(source)
    source = source.reshape(height, width, photo.channels)[::-1]
    turned = oriented(source, turn_of(camera) if turn is None else turn)
    pixels = undistorted(camera, turned, size)
    copy.pixels.foreach_set(np.ascontiguousarray(pixels[::-1]).ravel())
    copy.update()
    if not was_loaded:
        photo.buffers_free()
    copy.pack()


def undistorted(camera: Camera, pixels: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Pixels [h, w, 4] as the pinhole of the camera's fx, fy, cx, cy sees them, bilinear.

    Args:
        pixels: [H, W, C] of the photo, row 0 on top, C = 1, 3 or 4.
        size: (w, h) of the result.
    """
    width, height = size
    x, y, seen = _seen_from(camera.lens_key, size, pixels.shape[:2])
    left = np.minimum(x.astype(int), max(pixels.shape[1] - 2, 0))
    top = np.minimum(y.astype(int), max(pixels.shape[0] - 2, 0))
    right, bottom = np.minimum(left + 1, pixels.shape[1] - 1), np.minimum(top + 1, pixels.shape[0] - 1)
    a, b = (x - left)[:, None], (y - top)[:, None]
    upper = (1 - a) * pixels[top, left] + a * pixels[top, right]
    lower = (1 - a) * pixels[bottom, left] + a * pixels[bottom, right]
    values = (1 - b) * upper + b * lower
    out = np.ones((height * width, 4), dtype=np.float32)
    channels = pixels.shape[2]
    out[:, :3] = values[:, :3] if channels >= 3 else values[:, :1]
    if channels in (2, 4):
        out[:, 3] = values[:, -1]
    out[~seen] = 0
    return out.reshape(height, width, 4)


@lru_cache(maxsize=4)
def _seen_from(
    key: tuple, size: tuple[int, int], shape: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where a pinhole's pixels (w, h) lie in the photo [H, W], and which the lens reaches.

    Photos of one lens share it.
    """
    width, height = size
    camera = Camera("", None, np.eye(4), *key)
    pinhole = replace(camera, lens="pinhole", distortion=())
    row, column = np.mgrid[0:height, 0:width] + 0.5
    _, rays = pinhole.rays(column.ravel() * camera.width / width, row.ravel() * camera.height / height)
    found, _ = camera.project(rays)
    found *= np.array([shape[1] / camera.width, shape[0] / camera.height])
    x, y = found[:, 0] - 0.5, found[:, 1] - 0.5
    with np.errstate(invalid="ignore"):
        seen = (x > -1) & (y > -1) & (x < shape[1]) & (y < shape[0])
    x, y = np.where(seen, x, 0), np.where(seen, y, 0)
    return np.clip(x, 0, shape[1] - 1), np.clip(y, 0, shape[0] - 1), seen
