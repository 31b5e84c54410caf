"""Walks from points through a coarse grid on the CPU; `visibility_torch` is the plain twin."""

from __future__ import annotations

import math

import numba
import numpy as np

from .march_numba import DEPTH_UNIT, LEAST_OPAQUE, box_span
from .skipping import EMPTY

HALF = np.float32(math.log(2))


@numba.njit(parallel=True, fastmath=True, cache=True, nogil=True)
def look_around(points, directions, start, step, blocking, passing, distance):
    """See `visibility.look_around`."""
    cells = blocking.shape[0]
    for p in numba.prange(points.shape[0]):
        ox, oy, oz = points[p, 0], points[p, 1], points[p, 2]
        for d in range(directions.shape[0]):
            dx, dy, dz = directions[d, 0], directions[d, 1], directions[d, 2]
            near, far = box_span(ox, oy, oz, dx, dy, dz)
            t = max(near, np.float32(start))
            depth, half = np.float32(0.0), np.float32(math.inf)
            while t < far and depth < LEAST_OPAQUE:
                i = min(max(int((ox + t * dx) * cells), 0), cells - 1)
                j = min(max(int((oy + t * dy) * cells), 0), cells - 1)
                k = min(max(int((oz + t * dz) * cells), 0), cells - 1)
                code = blocking[i, j, k]
                if code < EMPTY:
                    before = depth
                    depth += DEPTH_UNIT * np.float32(code)
                    if before <= HALF and depth > HALF:
                        half = t
                    t += step
                else:
                    t += step * (code - EMPTY)
            passing[p, d] = math.exp(-depth)
            distance[p, d] = half
