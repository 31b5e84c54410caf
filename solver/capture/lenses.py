"""Lens distortion as OpenCV defines it, and its exact inverse.

Image coordinates are ideal ones: x right, y down, at unit distance. `opencv` is the rational model
k1 k2 p1 p2 k3 k4 k5 k6, `opencv_fisheye` the equidistant one k1 k2 k3 k4; missing numbers are 0.
https://docs.opencv.org/4.x/d9/d0c/group__calib3d.html and .../db/d58/group__calib3d__fisheye.html
`brown` is what photogrammetry programs have beyond these: see `_polynomial`.

Polynomials fold back somewhere: two directions on one pixel. Only the part up to the fold is the
lens. Directions beyond it have no pixel (NaN), pixels beyond its image have the fold's direction.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np

LENSES = ("pinhole", "opencv", "opencv_fisheye", "brown")
_STEPS = 60
_WIDEST = 1e4  # tangent of the widest half view a perspective lens may have


def distort(
    lens: str, distortion: tuple[float, ...], directions: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Distorted image coordinates (x, y) [N] of directions [N, 3] in OpenCV's camera axes.

    NaN where the lens does not see: behind a perspective camera, or beyond the fold.
    """
    if lens == "brown":
        return _brown_distort(distortion, directions)
    x, y, z = np.moveaxis(directions, -1, 0)
    if lens == "opencv_fisheye":
        across = np.hypot(x, y)
        angle = np.arctan2(across, z)
        radius = np.where(angle <= fold(lens, distortion), _fisheye(distortion, angle)[0], np.nan)
        scale = np.divide(radius, across, out=np.ones_like(radius), where=across > 1e-12)
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


def undistort(
    lens: str, distortion: tuple[float, ...], x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Directions [N, 3] (OpenCV's axes, not unit) whose distorted image is (x, y) [N].

    Returns also a mask [N]: false where no direction has that image. There the direction is the
    nearest the lens sees, so it is finite always.
    """
    x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if lens == "pinhole" or (lens == "opencv" and not any(distortion)):
        return np.stack([x, y, np.ones_like(x)], axis=-1), np.ones(x.shape, dtype=bool)
    if lens == "brown":
        return _brown_undistort(distortion, x, y)
    radius, limit = np.hypot(x, y), fold(lens, distortion)
    if lens == "opencv_fisheye":
        angle, met = _invert(lambda a: _fisheye(distortion, a), radius, limit)
        scale = np.divide(np.sin(angle), radius, out=np.ones_like(radius), where=radius > 1e-12)
        return np.stack([x * scale, y * scale, np.cos(angle)], axis=-1), met
    ideal, met = _invert(lambda r: _brown_radius(distortion, r), radius, min(limit, _WIDEST))
    scale = np.divide(ideal, radius, out=np.ones_like(radius), where=radius > 1e-12)
    u, v = x * scale, y * scale
    if any(distortion[2:4]):
        u, v, met = _refine(distortion, u, v, x, y, min(limit, _WIDEST))
    return np.stack([u, v, np.ones_like(u)], axis=-1), met


@lru_cache(maxsize=256)
def fold(lens: str, distortion: tuple[float, ...]) -> float:
    """Where the radial part stops growing: ideal radius (`opencv`) or angle (`opencv_fisheye`)."""
    if lens == "brown":
        k1, k2, _, _, k3, k4, _, equidistant = _eight(distortion)
        slope = np.array([9 * k4, 7 * k3, 5 * k2, 3 * k1, 1.0])  # in powers of r²
        return min(_first_positive_root(slope), np.pi if equidistant else np.inf)
    if lens == "opencv_fisheye":
        k = np.array((*distortion, 0, 0, 0, 0)[:4])
        slope = np.append((k * (3, 5, 7, 9))[::-1], 1.0)  # of θ(1 + k1 θ² + …), in powers of θ²
        return min(_first_positive_root(slope), np.pi)
    k1, k2, _, _, k3, k4, k5, k6 = (*distortion, 0, 0, 0, 0, 0, 0, 0, 0)[:8]
    above, below = np.poly1d([k3, k2, k1, 1.0]), np.poly1d([k6, k5, k4, 1.0])  # in powers of r²
    s = np.poly1d([1.0, 0.0])
    slope = above * below + 2 * s * (above.deriv() * below - above * below.deriv())
    return min(_first_positive_root(slope.c), _first_positive_root(below.c))


def _first_positive_root(coefficients: np.ndarray) -> float:
    """Square root of the smallest positive root of a polynomial in the squared radius."""
    coefficients = np.trim_zeros(np.asarray(coefficients, dtype=np.float64), "f")
    with np.errstate(all="ignore"):
        roots = np.roots(coefficients)
    # A double root is a touch of zero that rounding may move off the real line.
    real = roots.real[np.abs(roots.imag) <= 1e-7 * np.abs(roots)]
    real = real[np.isfinite(real) & (real > 1e-12)]
    return float(np.sqrt(real.min())) if len(real) else np.inf


def _fisheye(distortion: tuple[float, ...], angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Image radius and its slope at angles from the axis."""
    k1, k2, k3, k4 = (*distortion, 0, 0, 0, 0)[:4]
    t = angle * angle
    value = angle * (1 + t * (k1 + t * (k2 + t * (k3 + t * k4))))
    return value, 1 + t * (3 * k1 + t * (5 * k2 + t * (7 * k3 + t * 9 * k4)))


def _radial(distortion: tuple[float, ...], s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Radial factor of the rational model and its derivative at squared radii."""
    k1, k2, _, _, k3, k4, k5, k6 = (*distortion, 0, 0, 0, 0, 0, 0, 0, 0)[:8]
    above, below = 1 + s * (k1 + s * (k2 + s * k3)), 1 + s * (k4 + s * (k5 + s * k6))
    slope = (k1 + s * (2 * k2 + s * 3 * k3)) - above / below * (k4 + s * (2 * k5 + s * 3 * k6))
    return above / below, slope / below


def _brown_radius(distortion: tuple[float, ...], radius: np.ndarray):
    factor, slope = _radial(distortion, radius * radius)
    return radius * factor, factor + 2 * radius * radius * slope


def _brown(distortion: tuple[float, ...], x: np.ndarray, y: np.ndarray):
    """Distorted (u, v) of the perspective model, and the derivatives u_x, u_y = v_x, v_y."""
    p1, p2 = (*distortion, 0, 0, 0, 0)[2:4]
    s = x * x + y * y
    factor, slope = _radial(distortion, s)
    u = x * factor + 2 * p1 * x * y + p2 * (s + 2 * x * x)
    v = y * factor + p1 * (s + 2 * y * y) + 2 * p2 * x * y
    cross = 2 * (x * y * slope + p1 * x + p2 * y)
    u_x = factor + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
    v_y = factor + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
    return u, v, u_x, cross, v_y


def polynomial_lens(
    radial: Sequence[float], tangential: Sequence[float] = (0.0, 0.0), skew: float = 0.0,
    equidistant: bool = False,
) -> tuple[str, tuple[float, ...]]:  # fmt: skip
    """The plainest lens, and its numbers, for a polynomial distortion.

    Args:
        radial: k1 … k4, as many as there are. tangential: p1, p2 in OpenCV's order.
        skew: what a unit of y adds to x, after the distortion.
        equidistant: the polynomial acts on angles from the axis instead of their tangents.
    """
    k1, k2, k3, k4 = (*(float(k) for k in radial), 0.0, 0.0, 0.0, 0.0)[:4]
    p1, p2 = (float(p) for p in tangential)
    if skew or (k4 and not equidistant) or (equidistant and (p1 or p2)):
        return "brown", (k1, k2, p1, p2, k3, k4, float(skew), float(equidistant))
    if equidistant:
        return "opencv_fisheye", (k1, k2, k3, k4)
    return ("opencv", (k1, k2, p1, p2, k3)) if any((k1, k2, k3, p1, p2)) else ("pinhole", ())


def _eight(distortion: tuple[float, ...]) -> tuple[float, ...]:
    return (*distortion, 0, 0, 0, 0, 0, 0, 0, 0)[:8]


def _polynomial(distortion: tuple[float, ...], x: np.ndarray, y: np.ndarray):
    """(u, v) of the lens `brown`: k1 k2 p1 p2 k3 k4, skew, and 1 for a fisheye (else 0).

    x, y are ideal image coordinates, those of a fisheye shrunk to the angle from the axis. k1 … k4
    are the radial powers r² … r⁸, p1 and p2 OpenCV's tangential terms; `skew`·v is added to u.

    Returns also the radial factor and its derivative by r².
    """
    k1, k2, p1, p2, k3, k4, skew, _ = _eight(distortion)
    s = x * x + y * y
    factor = 1 + s * (k1 + s * (k2 + s * (k3 + s * k4)))
    u = x * factor + 2 * p1 * x * y + p2 * (s + 2 * x * x)
    v = y * factor + p1 * (s + 2 * y * y) + 2 * p2 * x * y
    return u + skew * v, v, factor, k1 + s * (2 * k2 + s * (3 * k3 + s * 4 * k4))


def _brown_distort(distortion: tuple[float, ...], directions: np.ndarray):
    x, y, z = np.moveaxis(np.asarray(directions, dtype=np.float64), -1, 0)
    across = np.hypot(x, y)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        if _eight(distortion)[7]:
            radius = np.arctan2(across, z)
            scale = np.where(across > 1e-12, radius / across, np.where(z > 0, 1 / z, np.nan))
        else:
            scale = np.where(z > 0, 1 / z, np.nan)
            radius = across * scale
        scale = np.where(radius <= fold("brown", distortion) * (1 + 1e-9), scale, np.nan)
        u, v, *_ = _polynomial(distortion, x * scale, y * scale)
    return u, v


def _brown_undistort(distortion: tuple[float, ...], u: np.ndarray, v: np.ndarray):
    _, _, p1, p2, _, _, skew, equidistant = _eight(distortion)
    limit = min(fold("brown", distortion), _WIDEST)

    def along(r: np.ndarray):
        _, _, factor, slope = _polynomial((*distortion[:2], 0, 0, *distortion[4:6]), r, 0 * r)
        return r * factor, factor + 2 * r * r * slope

    straight = u - skew * v
    radius = np.hypot(straight, v)
    ideal, met = _invert(along, radius, limit)
    scale = np.divide(ideal, radius, out=np.ones_like(radius), where=radius > 1e-12)
    x, y = straight * scale, v * scale
    if p1 or p2:
        plain = (*_eight(distortion)[:6], 0.0, 0.0)
        for _ in range(_STEPS):
            # Newton in the plane; a step neither leaves the lens nor crosses half of the plane.
            fu, fv, factor, slope = _polynomial(plain, x, y)
            a = factor + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
            d = factor + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
            b = 2 * (x * y * slope + p1 * x + p2 * y)
            determinant = a * d - b * b
            determinant = np.where(np.abs(determinant) < 1e-6, 1e-6, determinant)
            dx = (d * (fu - straight) - b * (fv - v)) / determinant
            dy = (a * (fv - v) - b * (fu - straight)) / determinant
            length = np.hypot(dx, dy)
            shorten = np.minimum(1, 0.5 * (1 + np.hypot(x, y)) / np.maximum(length, 1e-300))
            x, y = x - shorten * dx, y - shorten * dy
            inside = np.minimum(1, limit / np.maximum(np.hypot(x, y), 1e-300))
            x, y = x * inside, y * inside
            if (length <= 1e-14 * (1 + np.hypot(x, y))).all():
                break
        fu, fv, *_ = _polynomial(plain, x, y)
        met = np.hypot(fu - straight, fv - v) <= 1e-9 * (1 + radius)
    if not equidistant:
        return np.stack([x, y, np.ones_like(x)], axis=-1), met
    angle = np.hypot(x, y)
    sine = np.sinc(angle / np.pi)  # sin(angle) / angle, also at 0
    return np.stack([x * sine, y * sine, np.cos(angle)], axis=-1), met


def _invert(function: Callable, target: np.ndarray, limit: float):
    """Arguments in [0, limit] where a growing function takes its targets: Newton within brackets.

    Returns them and a mask of the targets that are reached.
    """
    low, high = np.zeros_like(target), np.full_like(target, limit)
    if not np.isfinite(limit):
        high = np.full_like(target, _WIDEST)
    guess = np.minimum(target, high)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        met = function(high)[0] >= target * (1 - 1e-12)
        for _ in range(_STEPS):
            value, slope = function(guess)
            low, high = np.where(value < target, guess, low), np.where(value < target, high, guess)
            step = (value - target) / slope
            after = guess - step
            inside = (after >= low) & (after <= high)
            after = np.where(inside, after, 0.5 * (low + high))
            done = np.abs(after - guess) <= 1e-15 + 1e-14 * np.abs(guess)
            guess = after
            if done.all():
                break
    return guess, met


def _refine(distortion: tuple[float, ...], u, v, x, y, limit: float):
    """Newton in the plane from the radial solution: adds the tangential part."""
    for _ in range(_STEPS):
        fu, fv, a, b, d = _brown(distortion, u, v)
        determinant = a * d - b * b
        determinant = np.where(np.abs(determinant) < 1e-6, 1e-6, determinant)
        du = (d * (fu - x) - b * (fv - y)) / determinant
        dv = (a * (fv - y) - b * (fu - x)) / determinant
        # A step never leaves the part of the plane the lens sees, and never crosses half of it.
        length = np.hypot(du, dv)
        shorten = np.minimum(1, 0.5 * (1 + np.hypot(u, v)) / np.maximum(length, 1e-300))
        u, v = u - shorten * du, v - shorten * dv
        outside = np.minimum(1, limit / np.maximum(np.hypot(u, v), 1e-300))
        u, v = u * outside, v * outside
        if (length <= 1e-14 * (1 + np.hypot(u, v))).all():
            break
    fu, fv, *_ = _brown(distortion, u, v)
    return u, v, np.hypot(fu - x, fv - y) <= 1e-9 * (1 + np.hypot(x, y))
