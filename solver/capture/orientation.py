"""Which way up a photo lies: what its EXIF orientation says, and whether its camera followed it."""

from __future__ import annotations

import numpy as np


def oriented(pixels: np.ndarray, orientation: int) -> np.ndarray:
    """Pixels [H, W, …] turned upright, a view: what an EXIF orientation from 1 to 8 asks for."""
    if orientation in (5, 6, 7, 8):
        pixels = pixels.swapaxes(0, 1)
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    return pixels


def as_camera_saw(
    pixels: np.ndarray, orientation: int, width: int, height: int
) -> np.ndarray | None:
    """Pixels [H, W, …] of a camera's size, as they lie in the file or else upright; None if neither.

    The one place that decides on EXIF orientation. Programs that solve cameras differ: most ignore
    the tag, some turn the photo first. The size they write down tells them apart, and where it does
    not (squares, half turns) the tag is ignored, as it is for Blender's background images.
    """
    if pixels.shape[:2] == (height, width):
        return pixels
    upright = oriented(pixels, orientation)
    return upright if upright.shape[:2] == (height, width) else None
