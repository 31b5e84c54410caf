"""What files say of a lens without distortion: its matrix, alone or in a projection, and the size of the
photo that is meant."""

from pathlib import Path

import numpy as np

from .errors import CaptureError
from .frames import rigid
from .image_header import image_size
from .intake import Intrinsics

OFF_CENTRE = 0.2
"""how far from the middle no lens's centre is, as a share of half the photo"""
FEWEST_PIXELS = 10.0
"""that a focal length has; that of a pose, which may be written as a projection, is 1"""
_NEAR = 0.04
"""how far from a whole number times its size a photo was resized by that number"""
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
        raise CaptureError(path, where, "this is not a lens's matrix (fx 0 cx, 0 fy cy, 0 0 1)")
    if abs(k[0, 1]) > _MOST_SKEW * abs(k[0, 0]):
        raise CaptureError(
            path, where, "its pixels are not rectangles (skew), which no lens here has",
            "export the cameras with square pixels",
        )  # fmt: skip
    return float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2])


def of_projection(
    path: Path, where: str, projection: np.ndarray
) -> tuple[tuple[float, float, float, float], np.ndarray]:
    """fx fy cx cy, in pixels as the projection counts them, and camera-to-world [4, 4] with OpenCV's axes.

    Args:
        projection: [3, 4], K [R | t], of any scale and sign (Hartley and Zisserman, Multiple View Geometry,
            6.2.4).

    Raises:
        CaptureError: this is no such matrix, or pixels are no rectangles.
    """
    matrix = projection[:, :3]
    largest = np.abs(matrix).max(initial=0)
    if not 1e-9 < largest < 1e12 or np.linalg.cond(matrix) > 1e12:
        raise CaptureError(path, where, "this is not a projection")
    # RQ by QR of the matrix turned around. A projection's sign is arbitrary; a rotation's is not.
    if np.linalg.det(matrix) < 0:
        projection = -projection
    q, r = np.linalg.qr(np.flipud(projection[:, :3]).T)
    k, rotation = np.flipud(np.fliplr(r.T)), np.flipud(q.T)
    signs = np.sign(np.diag(k))
    k, rotation = k * signs, rotation * signs[:, None]
    place = -np.linalg.solve(projection[:, :3], projection[:, 3])
    lens = pinhole_of(path, where, k)
    if lens[0] < FEWEST_PIXELS:  # DVR's
        raise CaptureError(path, where, "it does not lead to pixels", "give cameras that do")
    return lens, rigid(rotation.T, place)


def is_for_another_size(size: tuple[int, int], cx: float, cy: float) -> bool:
    """Whether a lens's centre, in pixels, tells of a photo of the same shape, but larger or smaller than
    `size` (width, height)."""
    across, down = 2 * cx / size[0], 2 * cy / size[1]
    return min(cx, cy) >= 1 and abs(across - 1) > OFF_CENTRE and abs(across / down - 1) < 0.5 * OFF_CENTRE


def size_meant(size: tuple[int, int], cx: float, cy: float) -> tuple[int, int]:
    """The size of the photo that a lens without one is for: this photo's, unless the lens's centre tells of
    another of the same shape."""
    if not is_for_another_size(size, cx, cy):
        return size
    wide, tall = 2 * cx, 2 * cy
    if not np.allclose((wide, tall), np.round((wide, tall)), rtol=0, atol=1e-3):
        # It was measured, so it tells the size but roughly; and most photos are resized by whole numbers.
        times = wide / size[0]
        whole = round(times) if times > 1 else 1 / round(1 / times)
        wide = whole * size[0] if abs(times / whole - 1) < _NEAR else wide
    return round(wide), round(wide * size[1] / size[0])


def lens_on(photo: Path | None, fx: float, fy: float, cx: float, cy: float) -> Intrinsics | None:
    """A lens in pixels of the photo, or of the larger or smaller one that its centre tells of; None without
    a photo."""
    return photo and Intrinsics(*size_meant(image_size(photo), cx, cy), fx, fy, cx, cy)
