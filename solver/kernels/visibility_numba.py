"""Walks from points through a coarse grid on the CPU; `visibility_torch` is the plain twin."""

import numba
import numpy as np

from .compiling import kernel
from .walk_numba import walk


@kernel
def look_around(points, directions, start, step, blocking, passing, distance):
    """See `visibility.look_around`."""
    count = directions.shape[0]
    owners, starts = np.zeros(count, np.int64), np.full(count, start, np.float32)
    for p in numba.prange(points.shape[0]):
        walk(
            points[p : p + 1], owners, directions, np.float32(1.0), starts, step, blocking,
            passing[p], distance[p],
        )  # fmt: skip
