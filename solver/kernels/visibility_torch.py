"""Plain twin of `visibility_numba` and `visibility_warp`."""

import math

import torch

from .march_torch import through_grid
from .skipping import roots_of

POINTS_AT_ONCE = 16
"""bounds the memory: every step of every ray is held at once"""


def look_around(points, directions, start, step, blocking):
    """See `visibility.look_around`."""
    if len(points) == 0:
        return points.new_empty(2, 0, len(directions)).unbind()
    roots = roots_of(blocking)
    pieces = points.split(POINTS_AT_ONCE)
    found = [_around(piece, directions, start, step, roots) for piece in pieces]
    passing, distance = zip(*found, strict=True)
    return torch.cat(passing), torch.cat(distance)


def _around(points, directions, start, step, roots):
    origins = points[:, None].expand(-1, len(directions), -1).reshape(-1, 3)
    rays = directions.expand(len(points), -1, -1).reshape(-1, 3)
    t, depth = through_grid(origins, rays, origins.new_full((len(origins),), start), step, roots)
    depth = depth.cumsum(-1)
    stopped = depth > math.log(2)
    first = t.gather(1, stopped.long().argmax(1, keepdim=True))[:, 0]
    distance = torch.where(stopped[:, -1], first, torch.full_like(first, math.inf))
    shape = len(points), len(directions)
    return torch.exp(-depth[:, -1]).view(shape), distance.view(shape)
