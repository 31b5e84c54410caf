"""The lens `fisheye_power`: fisheyes of photogrammetry programs, with even powers of the angle, too.

    k2 k3 k4, across, down

Coordinates, NaN and masks are as in `lenses`. A direction at angle θ from the axis has the image (a, b) of
length θ + k2 θ² + k3 θ³ + k4 θ⁴; then `across`·b is added to a and `down`·a to b.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from .brown_lens import polynomial_lens
from .lens_solve import Lens, Numbers, Pair, first_positive_root, invert_growing, scaled_to

POWER = ("fisheye_power",)
_PER_RADIAN = 2 / np.pi


def of_quarter_turns(
    powers: Sequence[float], matrix: Sequence[Sequence[float]]
) -> tuple[float, float, Lens] | None:
    """Focal lengths along x and y, and the plainest lens, of a polynomial for which a quarter turn is 1.

    Args:
        powers: p1 … p4; p1 is not 0.
        matrix: [2, 2] from the polynomial's image to pixels.

    Returns:
        None if no lens is the same: the image has no size, or is mirrored.
    """
    (xx, xy), (yx, yy) = matrix
    p1, p2, p3, p4 = powers
    if not (p1 and xx and yy) or not is_usable(POWER[0], (0, 0, 0, xy / xx, yx / yy)):
        return None
    k2, k3, k4 = (p / p1 * _PER_RADIAN**n for n, p in enumerate((p2, p3, p4), 1))
    focal = xx * p1 * _PER_RADIAN, yy * p1 * _PER_RADIAN
    if k2 or k4 or yx:
        return *focal, (POWER[0], (k2, k3, k4, xy / xx, yx / yy))
    return *focal, polynomial_lens((k3,), skew=xy / xx, equidistant=True)


def is_usable(lens: str, distortion: Numbers) -> bool:
    """False if the image would be flat or mirrored."""
    return distortion[3] * distortion[4] < 0.5


def distort(lens: str, distortion: Numbers, directions: np.ndarray) -> Pair:
    x, y, z = np.moveaxis(np.asarray(directions, dtype=np.float64), -1, 0)
    across = np.hypot(x, y)
    angle = np.arctan2(across, z)
    seen = (angle <= widest_angle(distortion)) & ((across > 1e-12) | (z > 0))
    scale = np.where(seen, scaled_to(_radius(distortion, angle)[0], across), np.nan)
    a, b = x * scale, y * scale
    return a + distortion[3] * b, b + distortion[4] * a


def undistort(lens: str, distortion: Numbers, x: np.ndarray, y: np.ndarray) -> Pair:
    _, _, _, aside, down = distortion
    a, b = (x - aside * y) / (1 - aside * down), (y - down * x) / (1 - aside * down)
    radius = np.hypot(a, b)
    angle, met = invert_growing(lambda t: _radius(distortion, t), radius, widest_angle(distortion))
    scale = scaled_to(np.sin(angle), radius)
    return np.stack([a * scale, b * scale, np.cos(angle)], axis=-1), met


@lru_cache(maxsize=256)
def widest_angle(distortion: Numbers) -> float:
    """Angle from the axis, rad, up to which the image's radius grows."""
    slope = np.append(1.0, np.array(distortion[:3]) * (2, 3, 4))
    return min(first_positive_root(slope) ** 2, np.pi)


def _radius(distortion: Numbers, angle: np.ndarray) -> Pair:
    """The image's radius at angles from the axis, and its slope."""
    k2, k3, k4 = distortion[:3]
    value = angle * (1 + angle * (k2 + angle * (k3 + angle * k4)))
    return value, 1 + angle * (2 * k2 + angle * (3 * k3 + angle * 4 * k4))
