"""The lens `brown`: what photogrammetry programs have beyond OpenCV's polynomials.

    k1 k2 p1 p2 k3 k4, skew, the projection, p3 p4; missing numbers are 0

Coordinates, NaN and masks are as in `lenses`. The projection is 0 for a perspective lens. Those of a
fisheye are shrunk before the polynomial: to the angle θ from the axis (1, equidistant) or to 2 sin(θ/2)
(2, equisolid). k1 … k4 are the radial powers r² … r⁸, p1 and p2 OpenCV's tangential terms, which are
multiplied by 1 + p3 r² + p4 r⁴; `skew`·v is added to u at last.
"""

from collections.abc import Sequence

import numpy as np

from .lens_solve import (
    WIDEST,
    Lens,
    Numbers,
    Pair,
    first_positive_root,
    invert_growing,
    refine_in_plane,
    scaled_to,
)

BROWN = ("brown",)
PERSPECTIVE, EQUIDISTANT, EQUISOLID = 0.0, 1.0, 2.0
"""the projection before the polynomial"""


def polynomial_lens(
    radial: Sequence[float], tangential: Sequence[float] = (0.0, 0.0), skew: float = 0.0,
    equidistant: bool = False, equisolid: bool = False,
) -> Lens:  # fmt: skip
    """The plainest lens, and its numbers, for a polynomial distortion.

    Args:
        radial: k1 … k4, as many as there are.
        tangential: p1, p2 in OpenCV's order, then p3, p4 if there are such.
        skew: what a unit of y adds to x, after the distortion.
        equidistant: the polynomial acts on angles from the axis instead of their tangents.
        equisolid: it acts on twice the sines of their halves.
    """
    k1, k2, k3, k4 = (*(float(k) for k in radial), 0.0, 0.0, 0.0, 0.0)[:4]
    p1, p2, p3, p4 = (*(float(p) for p in tangential), 0.0, 0.0)[:4]
    grows = (p1 or p2) and (p3 or p4)
    projection = EQUISOLID if equisolid else EQUIDISTANT if equidistant else PERSPECTIVE
    if equisolid or skew or (k4 and not equidistant) or (equidistant and (p1 or p2)) or grows:
        plain = (k1, k2, p1, p2, k3, k4, float(skew), projection)
        return "brown", (*plain, p3, p4) if grows else plain
    if equidistant:
        return "opencv_fisheye", (k1, k2, k3, k4)
    return ("opencv", (k1, k2, p1, p2, k3)) if any((k1, k2, k3, p1, p2)) else ("pinhole", ())


def distort(lens: str, distortion: Numbers, directions: np.ndarray) -> Pair:
    x, y, z = np.moveaxis(np.asarray(directions, dtype=np.float64), -1, 0)
    across = np.hypot(x, y)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        if projection := _ten(distortion)[7]:
            angle = np.arctan2(across, z)
            radius = 2 * np.sin(0.5 * angle) if projection == EQUISOLID else angle
            scale = np.where(across > 1e-12, radius / across, np.where(z > 0, 1 / z, np.nan))
        else:
            scale = np.where(z > 0, 1 / z, np.nan)
            radius = across * scale
        scale = np.where(radius <= fold(distortion) * (1 + 1e-9), scale, np.nan)
        u, v, *_ = _polynomial(distortion, x * scale, y * scale)
    return u + _ten(distortion)[6] * v, v


def undistort(lens: str, distortion: Numbers, u: np.ndarray, v: np.ndarray) -> Pair:
    k1, k2, p1, p2, k3, k4, skew, projection, *_ = _ten(distortion)
    limit = min(fold(distortion), WIDEST)

    def along(r: np.ndarray):
        value, _, slope, *_ = _polynomial((k1, k2, 0, 0, k3, k4), r, np.zeros_like(r))
        return value, slope

    straight = u - skew * v
    radius = np.hypot(straight, v)
    ideal, met = invert_growing(along, radius, limit)
    scale = scaled_to(ideal, radius)
    x, y = straight * scale, v * scale
    if p1 or p2:
        x, y, met = refine_in_plane(lambda x, y: _polynomial(distortion, x, y), x, y, straight, v, limit)
    if not projection:
        return np.stack([x, y, np.ones_like(x)], axis=-1), met
    angle = np.hypot(x, y)
    if projection == EQUISOLID:
        # With r = 2 sin(θ/2), sin θ / r is cos(θ/2), and cos θ is 1 − r²/2.
        half = np.sqrt(np.maximum((1 - 0.5 * angle) * (1 + 0.5 * angle), 0))
        return np.stack([x * half, y * half, 1 - 0.5 * angle * angle], axis=-1), met
    sine = np.sinc(angle / np.pi)  # sin(angle) / angle, also at 0
    return np.stack([x * sine, y * sine, np.cos(angle)], axis=-1), met


def fold(distortion: Numbers) -> float:
    """Where the radial part stops growing: ideal radius, or what a fisheye has instead."""
    k1, k2, _, _, k3, k4, _, projection, *_ = _ten(distortion)
    slope = np.array([1.0, 3 * k1, 5 * k2, 7 * k3, 9 * k4])  # in powers of r²
    straight_behind = {PERSPECTIVE: np.inf, EQUISOLID: 2.0}.get(projection, np.pi)
    return min(first_positive_root(slope), straight_behind)


def _ten(distortion: Numbers) -> Numbers:
    return (*distortion, *(0,) * 10)[:10]


def _polynomial(distortion: Numbers, x: np.ndarray, y: np.ndarray):
    """(u, v) before the skew, and the derivatives u_x, u_y, v_x, v_y."""
    k1, k2, p1, p2, k3, k4, _, _, p3, p4 = _ten(distortion)
    s = x * x + y * y
    factor = 1 + s * (k1 + s * (k2 + s * (k3 + s * k4)))
    slope = k1 + s * (2 * k2 + s * (3 * k3 + s * 4 * k4))
    found = decentred(x, y, factor, slope, p1, p2)
    return _with_higher(found, x, y, (p1, p2, p3, p4)) if p3 or p4 else found


def _with_higher(found: tuple, x: np.ndarray, y: np.ndarray, tangential: Numbers):
    """What `decentred` found, with its tangential part times 1 + p3 r² + p4 r⁴."""
    p1, p2, p3, p4 = tangential
    u, v, u_x, u_y, v_x, v_y = found
    s = x * x + y * y
    more = s * (p3 + s * p4)
    slope = 2 * (p3 + s * 2 * p4)  # times x or y it is a derivative of `more`
    a = 2 * p1 * x * y + p2 * (s + 2 * x * x)
    b = p1 * (s + 2 * y * y) + 2 * p2 * x * y
    cross = 2 * (p1 * x + p2 * y)
    return (
        u + a * more, v + b * more,
        u_x + (2 * p1 * y + 6 * p2 * x) * more + a * slope * x, u_y + cross * more + a * slope * y,
        v_x + cross * more + b * slope * x, v_y + (6 * p1 * y + 2 * p2 * x) * more + b * slope * y,
    )  # fmt: skip


def decentred(x: np.ndarray, y: np.ndarray, factor: np.ndarray, slope: np.ndarray, p1: float, p2: float):
    """(u, v) of points whose radial factor, and its derivative by the squared radius, are known, with
    tangential p1, p2 in OpenCV's order; and the derivatives u_x, u_y, v_x, v_y."""
    s = x * x + y * y
    u = x * factor + 2 * p1 * x * y + p2 * (s + 2 * x * x)
    v = y * factor + p1 * (s + 2 * y * y) + 2 * p2 * x * y
    cross = 2 * (x * y * slope + p1 * x + p2 * y)
    u_x = factor + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
    v_y = factor + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
    return u, v, u_x, cross, cross, v_y
