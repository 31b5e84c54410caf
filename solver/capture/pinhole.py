"""What files say of a lens without distortion: its matrix, and the size of the photo that is meant."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .errors import CaptureError

OFF_CENTRE = 0.2
"""how far from the middle no lens's centre is, as a share of half the photo"""
_MOST_SKEW = 0.02
"""of the focal length"""
_ZERO = 1e-6


def pinhole_of(path: Path, where: str, matrix: np.ndarray) -> tuple[float, float, float, float]:
    """fx fy cx cy, in pixels, of a matrix [3, 3] of camera coordinates to pixels, of any scale.

    Raises:
        CaptureError: this is no such matrix, or pixels are no rectangles.
    """
    with np.errstate(all="ignore"):
        k = matrix / matrix[2, 2]
    if not np.isfinite(k).all() or max(abs(k[1, 0]), abs(k[2, 0]), abs(k[2, 1])) > _ZERO:
        raise CaptureError(
            path, where, "this is no matrix of a lens (fx 0 cx, 0 fy cy, 0 0 1)",
            "export the cameras again",
        )  # fmt: skip
    if abs(k[0, 1]) > _MOST_SKEW * abs(k[0, 0]):
        raise CaptureError(
            path, where, "its pixels are not rectangles (skew), which no lens here has",
            "export the cameras with square pixels",
        )  # fmt: skip
    return float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2])


def is_for_another_size(size: tuple[int, int], cx: float, cy: float) -> bool:
    """Whether a lens's centre, in pixels, tells of a photo of the same shape, but larger or smaller than
    `size` (width, height)."""
    across, down = 2 * cx / size[0], 2 * cy / size[1]
    return (
        min(cx, cy) >= 1
        and abs(across - 1) > OFF_CENTRE
        and abs(across / down - 1) < 0.5 * OFF_CENTRE
    )


def size_meant(size: tuple[int, int], cx: float, cy: float) -> tuple[int, int]:
    """The size of the photo that a lens without one is for: this photo's, unless the lens's centre tells of
    another of the same shape."""
    if not is_for_another_size(size, cx, cy):
        return size
    return round(2 * cx), round(2 * cx * size[1] / size[0])
