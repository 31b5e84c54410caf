"""Grids of bytes that say how far a ray can go before it can meet anything.

A grid for marching holds 0 in cells where something may be, else by how many cells a ray can go on. A
grid for transmittance holds what lies at the corners of cells: the root of the optical depth there, in 1/32
below 128; or 128 + that number of cells at the lower corner of an empty one. Between corners the root is
trilinear: between nothing and opaque, the depth itself would be opaque nearly all the way.
"""

from collections.abc import Callable

import torch
from torch import Tensor

ROOTS_PER_UNIT = 32
LEAST_ROOT = 4
"""of a corner that blocks anything: a depth of 1/64"""
EMPTY = 128
SELF_SHADOW_COSINE = 0.2
"""of a ray and its surface: below it a ray starts no farther out than with it, for what lies there may be
another surface"""
# Each at most the sum of those before plus one: no gaps, even at a border.
_GROWTHS = (1, 2, 4, 8, 16)


def cells_at(points: Tensor, count: int) -> Tensor:
    """Cells [...], of `count` per axis, in which box coordinates [...] lie; beyond the box, those at its
    border."""
    return (points * count).long().clamp(0, count - 1)


def values_at(grid: Tensor, points: Tensor) -> Tensor:
    """Values [...] of a grid [K, K, K] at box points [..., 3]; beyond the box, those at its border."""
    index = cells_at(points, grid.shape[0])
    return grid[index[..., 0], index[..., 1], index[..., 2]]


def free_distance(blocked: Tensor) -> Tensor:
    """0 [K, K, K] (bytes) where `blocked`, else n if no cell within n − 1 cells is (largest norm)."""
    near, radius = blocked, 0
    free = (~blocked).to(torch.uint8)
    for growth in _GROWTHS:
        near = grown(near, growth)
        radius += growth
        free[~near] = radius + 1
    return free


def blocking_grid(depths: Tensor) -> Tensor:
    """The grid for `march.grid_transmittance` of depths [K + 1, K + 1, K + 1], those of a cell's edge."""
    codes = (depths.sqrt() * ROOTS_PER_UNIT).round().clamp(0, EMPTY - 1).to(torch.uint8)
    codes[codes < LEAST_ROOT] = 0
    blocked = of_corners(codes > 0, torch.logical_or)
    lower = codes[:-1, :-1, :-1]
    lower.copy_(torch.where(blocked, lower, EMPTY + free_distance(blocked)))
    return codes


def roots_of(blocking: Tensor) -> Tensor:
    """Roots of the optical depths at the corners of a grid made by `blocking_grid`."""
    return torch.where(blocking < EMPTY, blocking.float() / ROOTS_PER_UNIT, 0.0)


def between_corners(corners: Tensor, points: Tensor) -> Tensor:
    """Trilinear values [...] of corners [K + 1, K + 1, K + 1] at box points [..., 3], as `values_at`."""
    count = len(corners) - 1
    at = (points * count).clamp(0, count)
    (x, y, z), base = at.unbind(-1), at.long().clamp(max=count - 1)
    i, j, k = base.unbind(-1)

    def at_column(i, j):
        return torch.lerp(corners[i, j, k], corners[i, j, k + 1], z - k)

    def at_slice(i):
        return torch.lerp(at_column(i, j), at_column(i, j + 1), y - j)

    return torch.lerp(at_slice(i), at_slice(i + 1), x - i)


def of_corners(grid: Tensor, combine: Callable[[Tensor, Tensor], Tensor]) -> Tensor:
    """What all eight corners of each cell make together: [K + 1, K + 1, K + 1] → [K, K, K]."""
    grid = combine(grid[1:], grid[:-1])
    grid = combine(grid[:, 1:], grid[:, :-1])
    return combine(grid[..., 1:], grid[..., :-1])


def dilated(filled: Tensor, cells: int) -> Tensor:
    """A boolean grid [K, K, K] grown by `cells` cells in all directions, diagonals included."""
    for _ in range(cells):
        filled = grown(filled, 1)
    return filled


def grown(filled: Tensor, cells: int) -> Tensor:
    """A boolean grid [K, K, K] with all copies of it moved by ±`cells` along any axes."""
    for axis in range(3):
        size = filled.shape[axis] - cells
        if size > 0:
            moved = filled.clone()
            moved.narrow(axis, cells, size).logical_or_(filled.narrow(axis, 0, size))
            moved.narrow(axis, 0, size).logical_or_(filled.narrow(axis, cells, size))
            filled = moved
        else:
            filled = filled.any(axis, keepdim=True).expand_as(filled)
    return filled
