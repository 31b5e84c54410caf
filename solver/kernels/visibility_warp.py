"""Walks from points through a coarse grid in Warp, for CUDA; `visibility_torch` is the plain twin."""

import warp as wp

from .march_warp import through_grid
from .vectors_warp import Codes, Vectors, vector
from .warp_device import launched

wp.set_module_options({"enable_backward": False, "fast_math": True})


@wp.kernel
def _look_around(
    points: Vectors, directions: Vectors, start: float, step: float, blocking: Codes, passing: Vectors,
    distance: Vectors,
):  # fmt: skip
    p, d = wp.tid()
    found = through_grid(vector(points, p), vector(directions, d), start, step, blocking)
    passing[p, d] = found[0]
    distance[p, d] = found[1]


look_around = launched(_look_around, "passing", 2)
