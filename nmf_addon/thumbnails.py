"""The job's preview as icons for the panel: photo, render and normals."""

import logging
from pathlib import Path

import bpy
import bpy.utils.previews
import numpy as np

from .names import BASE_PACKAGE

NAMES = ("Photo", "Render", "Normals")  # in `preview/render.png` from left to right
_pictures = None
_log = logging.getLogger(BASE_PACKAGE)


def icons() -> list[tuple[str, int]]:
    """Caption and icon number of each picture; empty if there is no preview."""
    if _pictures is None:
        return []
    return [(name, _pictures[name].icon_id) for name in NAMES if name in _pictures]


def show(path: Path) -> None:
    """Show a preview; one that cannot be read leaves the panel without. Not while drawing."""
    clear()
    if _pictures is None or not path.is_file():
        return
    try:
        parts = read_parts(path, len(NAMES))
    except (RuntimeError, ValueError) as error:
        _log.warning("%s: the preview cannot be shown (%s)", path, error)
        return
    for name, pixels in zip(NAMES, parts, strict=True):
        picture = _pictures.new(name)
        picture.image_size = pixels.shape[1], pixels.shape[0]
        picture.image_pixels_float.foreach_set(np.ascontiguousarray(pixels).ravel())


def clear() -> None:
    if _pictures is not None:
        _pictures.clear()


def read_parts(path: Path, count: int) -> list[np.ndarray]:
    """Pictures [H, W, 4] that stand side by side in a file, bottom row first.

    Raises:
        RuntimeError, ValueError: Blender cannot read the file, or it is not that wide.
    """
    image = bpy.data.images.load(str(path))
    try:
        width, height = image.size
        if width < count or height < 1:
            raise ValueError("it is empty")
        pixels = np.empty(width * height * 4, np.float32)
        image.pixels.foreach_get(pixels)
    finally:
        bpy.data.images.remove(image)
    columns = width // count
    rows = pixels.reshape(height, width, 4)
    return [rows[:, n * columns : (n + 1) * columns] for n in range(count)]


def register() -> None:
    global _pictures
    _pictures = bpy.utils.previews.new()


def unregister() -> None:
    global _pictures
    if _pictures is not None:
        bpy.utils.previews.remove(_pictures)
        _pictures = None
