"""The lens `equirectangular`: panoramas of all directions, rows of one elevation, columns of one azimuth.

    x = atan2(X, Z), y = atan2(Y, √(X² + Z²))    of a direction (X, Y, Z) in OpenCV's camera axes

so x and y are angles, the focal lengths pixels per radian, and the picture's middle is where a perspective
camera would look. COLMAP's EQUIRECTANGULAR (sensor/models/spherical.h), OpenSfM's `spherical`
(camera_projections_functions.h), AliceVision's `equirectangular` (Equirectangular.cpp) and nerfstudio's
EQUIRECTANGULAR (cameras.py) are this.

The left edge, x = −π, and the right one show the same, and count as the left one: so each direction has
one pixel. Nothing is behind such a camera: its depths are distances.
"""

import numpy as np

from .lens_solve import Numbers, Pair

EQUIRECTANGULAR = "equirectangular"
PANORAMIC = (EQUIRECTANGULAR,)
_SLACK = 1 + 1e-9  # what comes back from the edge itself is still seen


def of_whole_sphere(width: float, height: float) -> tuple[float, float, float, float]:
    """fx fy cx cy, in pixels, of a picture of so many pixels that shows all directions."""
    return width / (2 * np.pi), height / np.pi, width / 2, height / 2


def in_turns(width: int, height: int) -> tuple[float, float, float, float]:
    """fx fy cx cy, in pixels, where both angles are counted in turns and lengths in the longer side, of
    whatever shape the picture is."""
    focal = max(width, height) / (2 * np.pi)
    return focal, focal, width / 2, height / 2


def shows_whole_sphere(
    width: int, height: int, fx: float, fy: float, cx: float, cy: float, share: float = 1e-6
) -> bool:
    """Whether a picture of so many pixels shows just all directions, to a share of its size."""
    wanted = np.array(of_whole_sphere(width, height))
    return bool((np.abs(np.array((fx, fy, cx, cy)) - wanted) <= share * wanted).all())


def is_usable(lens: str, distortion: Numbers) -> bool:
    """False for numbers that such a lens has not: it has none."""
    return not any(distortion)


def distort(lens: str, distortion: Numbers, directions: np.ndarray) -> Pair:
    """Image coordinates (x, y) [N], rad, of directions [N, 3] in OpenCV's camera axes; NaN of zero."""
    x, y, z = np.moveaxis(np.asarray(directions, dtype=np.float64), -1, 0)
    level = np.hypot(x, z)
    azimuth, elevation = np.arctan2(x, z), np.arctan2(y, level)
    azimuth = np.where(azimuth >= np.pi, -np.pi, azimuth)
    nowhere = ~(level + np.abs(y) > 0)
    return np.where(nowhere, np.nan, azimuth), np.where(nowhere, np.nan, elevation)


def undistort(lens: str, distortion: Numbers, x: np.ndarray, y: np.ndarray) -> Pair:
    """Unit directions [N, 3] of image coordinates [N], rad, and a mask [N] of those within the sphere."""
    met = (np.abs(x) <= np.pi * _SLACK) & (np.abs(y) <= np.pi / 2 * _SLACK)
    azimuth, elevation = np.clip(x, -np.pi, np.pi), np.clip(y, -np.pi / 2, np.pi / 2)
    level = np.cos(elevation)
    return np.stack([level * np.sin(azimuth), np.sin(elevation), level * np.cos(azimuth)], -1), met
