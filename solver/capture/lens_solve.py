"""Roots that lens models need: growing functions of one number, maps of the plane, polynomials' folds."""

from collections.abc import Callable

import numpy as np

Numbers = tuple[float, ...]
Lens = tuple[str, Numbers]
"""a lens's name with its numbers"""
Pair = tuple[np.ndarray, np.ndarray]
STEPS = 60
BRACKET_STEPS = 100
WIDEST = 1e4
"""tangent of the widest half view a perspective lens may have"""


def invert_growing(function: Callable, target: np.ndarray, limit: float) -> Pair:
    """Arguments [N] in [0, limit] where a growing function takes its targets [N].

    Newton within brackets, and bisection where a step is more than half as long as the one before:
    Newton's steps alone may go to and fro between two places. Returns them and a mask [N] of the
    targets that are reached.

    Args:
        function: from arguments [N] to values and slopes [N]; 0 at 0.
    """
    low, high = np.zeros_like(target), np.full_like(target, limit)
    if not np.isfinite(limit):
        high = np.full_like(target, WIDEST)
    guess = np.minimum(target, high)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        met = function(high)[0] >= target * (1 - 1e-12)
        length = high - low
        for _ in range(BRACKET_STEPS):
            value, slope = function(guess)
            low, high = np.where(value < target, guess, low), np.where(value < target, high, guess)
            after = guess - (value - target) / slope
            good = (after >= low) & (after <= high) & (np.abs(after - guess) <= 0.5 * length)
            after = np.where(good, after, 0.5 * (low + high))
            length = np.abs(after - guess)
            done = length <= 1e-15 + 1e-14 * np.abs(guess)
            guess = after
            if done.all():
                break
    return guess, met


def refine_in_plane(function: Callable, u, v, x, y, limit: float):
    """Newton in the plane from (u, v) [N] to where a map takes the values (x, y) [N].

    Returns u, v and a mask [N] of those that arrived.

    Args:
        function: from u, v to the map's two values and its derivatives x_u, x_v, y_u, y_v.
        limit: radius that (u, v) never leave.
    """
    for _ in range(STEPS):
        fu, fv, a, b, c, d = function(u, v)
        determinant = a * d - b * c
        determinant = np.where(np.abs(determinant) < 1e-6, 1e-6, determinant)
        du = (d * (fu - x) - b * (fv - y)) / determinant
        dv = (a * (fv - y) - c * (fu - x)) / determinant
        # A step never leaves the part of the plane the lens sees, and never crosses half of it.
        length = np.hypot(du, dv)
        shorten = np.minimum(1, 0.5 * (1 + np.hypot(u, v)) / np.maximum(length, 1e-300))
        u, v = u - shorten * du, v - shorten * dv
        outside = np.minimum(1, limit / np.maximum(np.hypot(u, v), 1e-300))
        u, v = u * outside, v * outside
        if (length <= 1e-14 * (1 + np.hypot(u, v))).all():
            break
    fu, fv, *_ = function(u, v)
    return u, v, np.hypot(fu - x, fv - y) <= 1e-9 * (1 + np.hypot(x, y))


def first_positive_root(coefficients: np.ndarray) -> float:
    """Square root of the smallest positive root of a polynomial in the squared radius, or infinity.

    Args:
        coefficients: lowest power first; the first one is not zero.
    """
    # `np.roots` has the highest power first, so these are the roots' inverses. What is divided by is the
    # constant, which is 1 in all lenses, and never a vanishing highest coefficient.
    with np.errstate(all="ignore"):
        inverse = np.roots(coefficients)
        # A double root is a touch of zero that rounding may move off the real line.
        real = inverse.real[np.abs(inverse.imag) <= 1e-7 * np.abs(inverse)]
        largest = real.max(initial=0.0)
        return float(np.sqrt(1 / largest)) if largest > 0 else np.inf


def scaled_to(values: np.ndarray, lengths: np.ndarray, at_zero: float = 1.0) -> np.ndarray:
    """`values / lengths` [N], and `at_zero` where the length vanishes."""
    ratio = np.full(np.shape(lengths), at_zero)
    return np.divide(values, lengths, out=ratio, where=np.asarray(lengths) > 1e-12)
