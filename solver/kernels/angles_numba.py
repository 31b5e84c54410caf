"""Angles for the kernels, of numbers and of `Rays`, to single precision: series that stay in registers.

A call of the C library, good as it is, has all that a loop holds in registers put aside and fetched
again; for the directions of a glossy ray that took longer than all the rest of their geometry.
"""

import math

from .compiling import function
from .ray_lanes import floor, where

TAN_EIGHTH = math.tan(math.pi / 8)


@function
def cosine_sine_of_turns(u):
    """cos 2πu and sin 2πu; Taylor series of half the angle, within a quarter of a turn, to 3e-8."""
    half = math.pi * (u - floor(u + 0.5))
    x = half * half
    cosine = 1.0 - x / 56 * (1.0 - x / 90 * (1.0 - x / 132))
    cosine = 1.0 - x / 2 * (1.0 - x / 12 * (1.0 - x / 30 * cosine))
    sine = 1.0 - x / 72 * (1.0 - x / 110 * (1.0 - x / 156))
    sine = half * (1.0 - x / 6 * (1.0 - x / 20 * (1.0 - x / 42 * sine)))
    return 1.0 - 2.0 * sine * sine, 2.0 * sine * cosine


@function
def angle_of(x, y):
    """Angle of (x, y) from the x axis in (−π, π], not both 0; series within π/8, to 2e-8."""
    wide, high = abs(x), abs(y)
    low, most = min(wide, high), max(wide, high)
    near = low <= TAN_EIGHTH * most
    # tan(a − π/4) = (tan a − 1)/(tan a + 1)
    t = where(near, low, low - most) / where(near, most, low + most)
    t2 = t * t
    series = 1 / 9 - t2 * (1 / 11 - t2 * (1 / 13 - t2 * (1 / 15)))
    series = 1.0 - t2 * (1 / 3 - t2 * (1 / 5 - t2 * (1 / 7 - t2 * series)))
    angle = t * series + where(near, 0.0, 0.25 * math.pi)
    angle = where(high > wide, 0.5 * math.pi - angle, angle)
    angle = where(x < 0.0, math.pi - angle, angle)
    return where(y < 0.0, -angle, angle)
