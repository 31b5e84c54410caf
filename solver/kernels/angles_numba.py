"""Angles for the kernels, to single precision: series that stay in registers.

A call of the C library, good as it is, has all that a loop holds in registers put aside and fetched
again; for the directions of a glossy ray that took longer than all the rest of their geometry.
"""

from __future__ import annotations

import math

from .compiling import inlined

TAN_EIGHTH = math.tan(math.pi / 8)


@inlined
def cosine_sine_of_turns(u):
    """cos 2πu and sin 2πu; Taylor series within an eighth of a turn, to 3e-8."""
    quarters = math.floor(4.0 * u + 0.5)
    x = 2.0 * math.pi * (u - 0.25 * quarters)
    x2 = x * x
    cosine = 1.0 - x2 / 2 * (1.0 - x2 / 12 * (1.0 - x2 / 30 * (1.0 - x2 / 56)))
    sine = x * (1.0 - x2 / 6 * (1.0 - x2 / 20 * (1.0 - x2 / 42 * (1.0 - x2 / 72))))
    quarter = int(quarters) & 3
    if quarter & 1:
        cosine, sine = -sine, cosine
    return (-cosine, -sine) if quarter & 2 else (cosine, sine)


@inlined
def angle_of(x, y):
    """Angle of (x, y) from the x axis in (−π, π], not both 0; series within π/8, to 2e-8."""
    wide, high = abs(x), abs(y)
    low, most = min(wide, high), max(wide, high)
    near = low <= TAN_EIGHTH * most
    # tan(a − π/4) = (tan a − 1)/(tan a + 1)
    t = low / most if near else (low - most) / (low + most)
    t2 = t * t
    series = 1 / 9 - t2 * (1 / 11 - t2 * (1 / 13 - t2 * (1 / 15)))
    series = 1.0 - t2 * (1 / 3 - t2 * (1 / 5 - t2 * (1 / 7 - t2 * series)))
    angle = t * series + (0.0 if near else 0.25 * math.pi)
    if high > wide:
        angle = 0.5 * math.pi - angle
    if x < 0.0:
        angle = math.pi - angle
    return -angle if y < 0.0 else angle
