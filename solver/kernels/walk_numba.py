"""Walks of rays through a grid of occupancy on the CPU; `march_torch.through_grid` is the plain twin.

Where a ray reads next depends on what it has just read, so a single one leaves the processor waiting.
Several walk in turns, and where one has ended, the next one takes its place.
"""

from __future__ import annotations

import math

import numpy as np

from .compiling import function, inlined
from .skipping import DEPTHS_PER_UNIT, EMPTY

LANES = 6
"""rays side by side; of 2, 3, 4, 6, 8 and 16 the fastest"""
DEPTH_UNIT = np.float32(1 / DEPTHS_PER_UNIT)
LEAST_OPAQUE = np.float32(7.0)
"""optical depth from which nothing passes"""
HALF = np.float32(math.log(2))
"""optical depth that half of the light passes"""
LEAST_SLOPE = np.float32(1e-12)
DISTANCE, FAR, DEPTH, ORIGIN, DIRECTION, COLUMNS = 0, 1, 2, 3, 6, 9  # of a lane's state; in cells


@inlined
def axis_span(o, d):
    inverse = np.float32(1.0) / (d if abs(d) > LEAST_SLOPE else LEAST_SLOPE)
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


@inlined
def enter(state, lane, origin, direction, scale, start, cells):
    """Put a ray on a lane."""
    dx, dy, dz = direction[0] * scale, direction[1] * scale, direction[2] * scale
    near, far = box_span(origin[0], origin[1], origin[2], dx, dy, dz)
    state[lane, DISTANCE], state[lane, FAR], state[lane, DEPTH] = max(near, start), far, 0.0
    for axis, d in enumerate((dx, dy, dz)):
        state[lane, ORIGIN + axis], state[lane, DIRECTION + axis] = origin[axis] * cells, d * cells


@inlined
def cell_of(state, lane, axis, t, cells):
    return min(
        max(int(state[lane, ORIGIN + axis] + t * state[lane, DIRECTION + axis]), 0), cells - 1
    )


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
    cells = blocking.shape[0]
    state = np.zeros((LANES, COLUMNS), np.float32)
    rays = np.full(LANES, -1)
    upcoming, walking = 0, True
    while walking:
        walking = False
        for lane in range(LANES):
            t = state[lane, DISTANCE]
            if t < state[lane, FAR]:
                walking = True
                i = cell_of(state, lane, 0, t, cells)
                j = cell_of(state, lane, 1, t, cells)
                code = blocking[i, j, cell_of(state, lane, 2, t, cells)]
                if code >= EMPTY:
                    state[lane, DISTANCE] = t + step * np.float32(code - EMPTY)
                    continue
                before = state[lane, DEPTH]
                depth = before + DEPTH_UNIT * np.float32(code)
                state[lane, DEPTH] = depth
                state[lane, DISTANCE] = t + step if depth < LEAST_OPAQUE else state[lane, FAR]
                if half.shape[0] > 0 and before <= HALF and depth > HALF:
                    half[rays[lane]] = t
                continue
            if rays[lane] >= 0:
                passing[rays[lane]] = math.exp(-state[lane, DEPTH])
                rays[lane] = -1
            if upcoming < passing.shape[0]:
                walking = True
                origin, direction = origins[owners[upcoming]], directions[upcoming]
                enter(state, lane, origin, direction, scale, start[upcoming], cells)
                if half.shape[0] > 0:
                    half[upcoming] = math.inf
                rays[lane] = upcoming
                upcoming += 1
