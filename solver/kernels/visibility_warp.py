"""Walks from points through a coarse grid in Warp, for CUDA; `visibility_torch` is the plain twin."""

from __future__ import annotations

import math

import warp as wp

from .march_warp import DEPTH_UNIT, EMPTY, box_span, code_at, row_of
from .warp_device import launch

wp.set_module_options({"enable_backward": False, "fast_math": True})

HALF = wp.constant(math.log(2))
NEVER = wp.constant(wp.inf)


@wp.kernel
def _look_around(
    points: wp.array2d(dtype=float), directions: wp.array2d(dtype=float), start: float, step: float,
    blocking: wp.array3d(dtype=wp.uint8), passing: wp.array2d(dtype=float),
    distance: wp.array2d(dtype=float),
):  # fmt: skip
    p, d = wp.tid()
    origin = row_of(points, p)
    direction = row_of(directions, d)
    span = box_span(origin, direction)
    t = float(wp.max(span[0], start))
    depth = float(0.0)
    half = float(NEVER)
    while t < span[1] and depth < 7.0:
        code = code_at(blocking, origin + t * direction)
        if code < EMPTY:
            before = depth
            depth += DEPTH_UNIT * float(code)
            if before <= HALF and depth > HALF:
                half = t
            t += step
        else:
            t += step * float(code - EMPTY)
    passing[p, d] = wp.exp(-depth)
    distance[p, d] = half


def look_around(points, directions, start, step, blocking, passing, distance) -> None:
    dim = len(points), len(directions)
    launch(_look_around, dim, points, directions, start, step, blocking, passing, distance)
