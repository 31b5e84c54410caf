"""Walks of rays through a grid of occupancy on the CPU; `march_torch.through_grid` is the plain twin.

Where a ray reads next depends on what it has just read, so a single one leaves the processor waiting.
A crowd walks side by side until the last one has ended (`ray_lanes`).
"""

import math

import numpy as np

from .compiling import function, inlined
from .lanes import load, store
from .ray_lanes import CROWD, any_of, codes_at, crowd_of, floor, where
from .skipping import EMPTY, ROOTS_PER_UNIT
from .vectors_numba import three_of, times

DEPTH_UNIT = np.float32(1 / ROOTS_PER_UNIT**2)
WITHIN = np.float32(1 - 1e-6)
"""of an edge, so that what lies at its end is in the last cell"""
LEAST_OPAQUE = np.float32(7.0)
"""optical depth from which nothing passes"""
HALF = np.float32(math.log(2))
"""optical depth that half of the light passes"""
LEAST_SLOPE = np.float32(1e-12)
NEVER = np.float32(1e30)
ORIGIN, DIRECTION, START, ROOM = 0, 3, 6, 7  # of what is known of a ray


@inlined
def axis_span(o, d):
    inverse = np.float32(1.0) / where(abs(d) > LEAST_SLOPE, d, LEAST_SLOPE)
    at_low = -o * inverse
    at_high = at_low + inverse
    return min(at_low, at_high), max(at_low, at_high)


@inlined
def box_span(ox, oy, oz, dx, dy, dz):
    """Entry and exit distance of a ray through [0, 1]^3 (slab test); entry > exit if it misses."""
    near_x, far_x = axis_span(ox, dx)
    near_y, far_y = axis_span(oy, dy)
    near_z, far_z = axis_span(oz, dz)
    return max(near_x, max(near_y, near_z)), min(far_x, min(far_y, far_z))


@function
def enter(known, base, origins, owners, directions, scale, start):
    """Rays from `base` on, a crowd at most: origins, directions, from where and how far each is walked."""
    none = crowd_of(0.0)
    last = np.uint64(start.shape[0] - 1)
    for lane in range(np.uint64(CROWD)):  # those too many do what the last one does
        ray = min(np.uint64(base) + lane, last)
        owner = np.uint64(owners[ray])
        for c in range(3):
            known[ORIGIN + c, lane] = origins[owner, c]
            known[DIRECTION + c, lane] = directions[ray, c] * scale
        known[START, lane] = start[ray]
    o, d = three_of(known, ORIGIN, none), three_of(known, DIRECTION, none)
    near, far = box_span(o[0], o[1], o[2], d[0], d[1], d[2])
    return o, d, max(near, load(known, (START, 0), none)), far


@inlined
def root_at(codes, i, j, k):
    code = codes_at(codes, i, j, k)
    return where(code >= float(EMPTY), 0.0, code)


@inlined
def column(codes, i, j, k, along):
    low = root_at(codes, i, j, k)
    return low + along * (root_at(codes, i, j, k + 1.0) - low)


@inlined
def root_between(codes, x, y, z, i, j, k):
    """Trilinear between the corners of the cells ⌊x⌋, ⌊y⌋, ⌊z⌋ = i, j, k, in units of codes."""
    low = column(codes, i, j, k, z - k)
    low = low + (y - j) * (column(codes, i, j + 1.0, k, z - k) - low)
    high = column(codes, i + 1.0, j, k, z - k)
    high = high + (y - j) * (column(codes, i + 1.0, j + 1.0, k, z - k) - high)
    return low + (x - i) * (high - low)


@function
def walk(origins, owners, directions, scale, start, step, blocking, passing, half):
    """Transmittances [R] of rays through a grid made by `skipping.blocking_grid`, a cell a step, and the
    distances at which half of their light is stopped, or infinity.

    Args:
        origins: [O, 3] box units. owners: [R] whose origin a ray has. directions: [R, 3] of which
            `scale` makes box units.
        start: [R] distances from which rays can be blocked; may be `passing`.
        half: [R], or empty where nobody asks.
    """
    cells, count, asked = np.float32(blocking.shape[0] - 1), passing.shape[0], half.shape[0] > 0
    last = cells * WITHIN
    known = np.empty((ROOM, CROWD), np.float32)
    for base in range(0, count, CROWD):
        o, d, t, far = enter(known, base, origins, owners, directions, scale, start)
        o, d = times(cells, o), times(cells, d)
        depth, found, anyone = crowd_of(0.0), crowd_of(NEVER), True
        while anyone:
            x = min(max(o[0] + t * d[0], 0.0), last)
            y = min(max(o[1] + t * d[1], 0.0), last)
            z = min(max(o[2] + t * d[2], 0.0), last)
            i, j, k = floor(x), floor(y), floor(z)
            code = codes_at(blocking, i, j, k)
            empty = code >= float(EMPTY)
            walking = (t < far) & (depth < LEAST_OPAQUE)
            deeper = depth
            if any_of(walking & (code < float(EMPTY))):
                root = root_between(blocking, x, y, z, i, j, k)
                deeper = depth + where(walking, DEPTH_UNIT * root * root, 0.0)
            if asked:
                found = where((depth <= HALF) & (deeper > HALF), t, found)
            depth = deeper
            t = t + where(empty, step * (code - float(EMPTY)), step)
            anyone = any_of(walking)
        store(known, (0, 0), depth)
        store(known, (1, 0), found)
        for lane in range(np.uint64(min(CROWD, count - base))):
            ray = np.uint64(base) + lane
            passing[ray] = math.exp(-known[0, lane]) if known[0, lane] > 0.0 else 1.0
            if asked:
                half[ray] = known[1, lane] if known[1, lane] < NEVER else math.inf
