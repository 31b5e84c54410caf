"""Walks from points through a coarse grid on the CPU; `visibility_torch` is the plain twin."""

from __future__ import annotations

import numba
import numpy as np

from .march_numba import through_grid


@numba.njit(parallel=True, fastmath=True, cache=True, nogil=True)
def look_around(points, directions, start, step, blocking, passing, distance):
    """See `visibility.look_around`."""
    for p in numba.prange(points.shape[0]):
        for d in range(directions.shape[0]):
            passing[p, d], distance[p, d] = through_grid(
                points[p, 0], points[p, 1], points[p, 2],
                directions[d, 0], directions[d, 1], directions[d, 2], np.float32(start), step, blocking,
            )  # fmt: skip
