"""Fisheye lenses with tangential and thin-prism distortion, as COLMAP has them.

A direction at angle θ from the axis first has the equidistant image (a, b) of length θ; a map of
the plane moves it. Numbers:

    thin_prism_fisheye          k1 k2 p1 p2 k3 k4 sx1 sy1       Weng et al. 1992
    rad_tan_thin_prism_fisheye  k0 k1 k2 k3 k4 k5 p0 p1 s0 s1 s2 s3     Project Aria's Fisheye624

Both see as far as their radial part grows. Coordinates, NaN and masks are as in `lenses`.
"""

from functools import lru_cache

import numpy as np

from .lens_solve import Numbers, Pair, first_positive_root, invert_growing, refine_in_plane, scaled_to

PRISM = ("thin_prism_fisheye", "rad_tan_thin_prism_fisheye")


def distort(lens: str, distortion: Numbers, directions: np.ndarray) -> Pair:
    x, y, z = np.moveaxis(np.asarray(directions, dtype=np.float64), -1, 0)
    across = np.hypot(x, y)
    angle = np.arctan2(across, z)
    seen = (angle <= widest_angle(lens, distortion)) & ((across > 1e-12) | (z > 0))
    scale = np.where(seen, scaled_to(angle, across), np.nan)
    image_x, image_y, *_ = _map(lens, distortion, x * scale, y * scale)
    return image_x, image_y


def undistort(lens: str, distortion: Numbers, x: np.ndarray, y: np.ndarray) -> Pair:
    radius, limit = np.hypot(x, y), widest_angle(lens, distortion)
    radial = _radial_numbers(lens, distortion)
    angle, _ = invert_growing(lambda a: _radial_image(radial, a), radius, limit)
    scale = scaled_to(angle, radius)
    with np.errstate(all="ignore"):
        a, b, met = refine_in_plane(
            lambda u, v: _map(lens, distortion, u, v), x * scale, y * scale, x, y, limit
        )
    angle = np.hypot(a, b)
    scale = scaled_to(np.sin(angle), angle)
    return np.stack([a * scale, b * scale, np.cos(angle)], axis=-1), met


@lru_cache(maxsize=256)
def widest_angle(lens: str, distortion: Numbers) -> float:
    """Angle from the axis, rad, up to which the radial part grows."""
    radial = np.array(_radial_numbers(lens, distortion))
    slope = np.append(1.0, radial * (2 * np.arange(len(radial)) + 3))
    return min(first_positive_root(slope), np.pi)


def _radial_numbers(lens: str, distortion: Numbers) -> Numbers:
    return distortion[:6] if lens == PRISM[1] else (*distortion[:2], *distortion[4:6])


def _radial_factor(radial: Numbers, squared: np.ndarray):
    """1 + k1 s + k2 s² + … and its derivative in s."""
    value, slope = np.zeros_like(squared), np.zeros_like(squared)
    for number in reversed((1.0, *radial)):
        slope = slope * squared + value
        value = value * squared + number
    return value, slope


def _radial_image(radial: Numbers, angle: np.ndarray):
    factor, slope = _radial_factor(radial, angle * angle)
    return angle * factor, factor + 2 * angle * angle * slope


def _map(lens: str, distortion: Numbers, a: np.ndarray, b: np.ndarray):
    """Image (x, y) of equidistant (a, b), and the derivatives x_a, x_b, y_a, y_b."""
    factor, slope = _radial_factor(_radial_numbers(lens, distortion), a * a + b * b)
    cross = 2 * a * b * slope
    moved = a * factor, b * factor
    turned = factor + 2 * a * a * slope, cross, cross, factor + 2 * b * b * slope
    if lens == PRISM[0]:
        p1, p2, sx, sy = *distortion[2:4], *distortion[6:8]
        x, y, *moves = _bend(a, b, p2, p1, sx, 0.0, sy, 0.0)
        # The prism's part adds to the radial one instead of following it.
        return x + moved[0], y + moved[1], *(m + t for m, t in zip(moves, turned, strict=True))
    x, y, x_u, x_v, y_u, y_v = _bend(*moved, *distortion[6:12])
    u_a, u_b, v_a, v_b = turned
    return (
        x + moved[0], y + moved[1],
        (1 + x_u) * u_a + x_v * v_a, (1 + x_u) * u_b + x_v * v_b,
        y_u * u_a + (1 + y_v) * v_a, y_u * u_b + (1 + y_v) * v_b,
    )  # fmt: skip


def _bend(u, v, px: float, py: float, s0: float, s1: float, s2: float, s3: float):
    """What tangential and prism distortion add to (u, v), and its derivatives by u and v."""
    s = u * u + v * v
    by_u, by_v = s0 + 2 * s1 * s, s2 + 2 * s3 * s
    return (
        2 * py * u * v + px * (s + 2 * u * u) + s * (s0 + s1 * s),
        2 * px * u * v + py * (s + 2 * v * v) + s * (s2 + s3 * s),
        2 * py * v + 6 * px * u + 2 * u * by_u, 2 * py * u + 2 * px * v + 2 * v * by_u,
        2 * px * v + 2 * py * u + 2 * u * by_v, 2 * px * u + 6 * py * v + 2 * v * by_v,
    )  # fmt: skip
