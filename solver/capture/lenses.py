"""Lens distortion, as OpenCV and others define it, and its exact inverse.

Image coordinates are ideal ones: x right, y down, at unit distance. `opencv` is the rational model
k1 k2 p1 p2 k3 k4 k5 k6, `opencv_fisheye` the equidistant one k1 k2 k3 k4; missing numbers are 0.
`brown_lens`, `closed_lenses`, `prism_lenses`, `fisheye_power` and `panoramic_lens` have those of other
programs, with all their numbers.
https://docs.opencv.org/4.x/d9/d0c/group__calib3d.html and .../db/d58/group__calib3d__fisheye.html

Polynomials fold back somewhere: two directions on one pixel. Only the part up to the fold is the
lens. Directions beyond it have no pixel (NaN), pixels beyond its image have the fold's direction.
"""

from functools import lru_cache

import numpy as np

from . import brown_lens, closed_lenses, fisheye_power, panoramic_lens, prism_lenses
from .brown_lens import BROWN, decentred
from .closed_lenses import CLOSED
from .fisheye_power import POWER
from .lens_solve import (
    WIDEST,
    Numbers,
    Pair,
    first_positive_root,
    invert_growing,
    refine_in_plane,
    scaled_to,
)
from .panoramic_lens import PANORAMIC
from .prism_lenses import PRISM

_MODULES = {
    **dict.fromkeys(BROWN, brown_lens), **dict.fromkeys(CLOSED, closed_lenses),
    **dict.fromkeys(PRISM, prism_lenses), **dict.fromkeys(POWER, fisheye_power),
    **dict.fromkeys(PANORAMIC, panoramic_lens),
}  # fmt: skip
LENSES = ("pinhole", "opencv", "opencv_fisheye", *_MODULES)
_LARGEST = 1e6
"""numbers of real lenses are tiny; squares of these still have room"""


def is_usable(lens: str, distortion: Numbers) -> bool:
    """False for numbers with which no lens is one."""
    if any(not abs(number) < _LARGEST for number in distortion):
        return False
    return lens not in (*CLOSED, *POWER, *PANORAMIC) or _MODULES[lens].is_usable(lens, distortion)


def distort(lens: str, distortion: Numbers, directions: np.ndarray) -> Pair:
    """Distorted image coordinates (x, y) [N] of directions [N, 3] in OpenCV's camera axes.

    NaN where the lens does not see: behind a perspective camera, or beyond the fold.
    """
    if lens in _MODULES:
        return _MODULES[lens].distort(lens, distortion, directions)
    x, y, z = np.moveaxis(directions, -1, 0)
    if lens == "opencv_fisheye":
        across = np.hypot(x, y)
        angle = np.arctan2(across, z)
        radius = np.where(angle <= fold(lens, distortion), _fisheye(distortion, angle)[0], np.nan)
        scale = scaled_to(radius, across)
        # On the axis itself across is 0 and so is the image; behind it there is no image.
        scale = np.where((across <= 1e-12) & (z <= 0), np.nan, scale)
        return x * scale, y * scale
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = np.where(z > 0, x / z, np.nan), np.where(z > 0, y / z, np.nan)
    if lens == "opencv" and any(distortion):
        with np.errstate(invalid="ignore", over="ignore"):
            seen = np.hypot(x, y) <= fold(lens, distortion) * (1 + 1e-9)
            u, v, *_ = _brown(distortion, x, y)
            return np.where(seen, u, np.nan), np.where(seen, v, np.nan)
    return x, y


def undistort(lens: str, distortion: Numbers, x: np.ndarray, y: np.ndarray) -> Pair:
    """Directions [N, 3] (OpenCV's axes, not unit) whose distorted image is (x, y) [N].

    Returns also a mask [N]: false where no direction has that image. There the direction is the
    nearest the lens sees, so it is finite always.
    """
    x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if lens == "pinhole" or (lens == "opencv" and not any(distortion)):
        return np.stack([x, y, np.ones_like(x)], axis=-1), np.ones(x.shape, dtype=bool)
    if lens in _MODULES:
        return _MODULES[lens].undistort(lens, distortion, x, y)
    radius, limit = np.hypot(x, y), fold(lens, distortion)
    if lens == "opencv_fisheye":
        angle, met = invert_growing(lambda a: _fisheye(distortion, a), radius, limit)
        scale = scaled_to(np.sin(angle), radius)
        return np.stack([x * scale, y * scale, np.cos(angle)], axis=-1), met
    ideal, met = invert_growing(lambda r: _brown_radius(distortion, r), radius, min(limit, WIDEST))
    scale = scaled_to(ideal, radius)
    u, v = x * scale, y * scale
    if any(distortion[2:4]):
        u, v, met = refine_in_plane(lambda u, v: _brown(distortion, u, v), u, v, x, y, min(limit, WIDEST))
    return np.stack([u, v, np.ones_like(u)], axis=-1), met


@lru_cache(maxsize=256)
def fold(lens: str, distortion: Numbers) -> float:
    """Where the radial part stops growing: ideal radius (`opencv`) or angle (`opencv_fisheye`)."""
    if lens == "opencv_fisheye":
        k = np.array((*distortion, 0, 0, 0, 0)[:4])
        slope = np.append(1.0, k * (3, 5, 7, 9))  # of θ(1 + k1 θ² + …), in powers of θ²
        return min(first_positive_root(slope), np.pi)
    k1, k2, _, _, k3, k4, k5, k6 = (*distortion, 0, 0, 0, 0, 0, 0, 0, 0)[:8]
    above, below = np.poly1d([k3, k2, k1, 1.0]), np.poly1d([k6, k5, k4, 1.0])  # in powers of r²
    s = np.poly1d([1.0, 0.0])
    slope = above * below + 2 * s * (above.deriv() * below - above * below.deriv())
    return min(first_positive_root(slope.c[::-1]), first_positive_root(below.c[::-1]))


def _fisheye(distortion: Numbers, angle: np.ndarray) -> Pair:
    """Image radius and its slope at angles from the axis."""
    k1, k2, k3, k4 = (*distortion, 0, 0, 0, 0)[:4]
    t = angle * angle
    value = angle * (1 + t * (k1 + t * (k2 + t * (k3 + t * k4))))
    return value, 1 + t * (3 * k1 + t * (5 * k2 + t * (7 * k3 + t * 9 * k4)))


def _radial(distortion: Numbers, s: np.ndarray) -> Pair:
    """Radial factor of the rational model and its derivative at squared radii."""
    k1, k2, _, _, k3, k4, k5, k6 = (*distortion, 0, 0, 0, 0, 0, 0, 0, 0)[:8]
    above, below = 1 + s * (k1 + s * (k2 + s * k3)), 1 + s * (k4 + s * (k5 + s * k6))
    slope = (k1 + s * (2 * k2 + s * 3 * k3)) - above / below * (k4 + s * (2 * k5 + s * 3 * k6))
    return above / below, slope / below


def _brown_radius(distortion: Numbers, radius: np.ndarray):
    factor, slope = _radial(distortion, radius * radius)
    return radius * factor, factor + 2 * radius * radius * slope


def _brown(distortion: Numbers, x: np.ndarray, y: np.ndarray):
    """Distorted (u, v) of the perspective model, and the derivatives u_x, u_y, v_x, v_y."""
    p1, p2 = (*distortion, 0, 0, 0, 0)[2:4]
    factor, slope = _radial(distortion, x * x + y * y)
    return decentred(x, y, factor, slope, p1, p2)
