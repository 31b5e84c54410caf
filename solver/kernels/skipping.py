"""Grids of bytes that say how far a ray can go before it can meet anything.

A grid for marching holds 0 in cells where something may be, else by how many cells a ray can go on. A
grid for transmittance holds optical depths in 1/32 below 128, else 128 + that number of cells.
"""

from __future__ import annotations

import torch

DEPTHS_PER_UNIT = 32
EMPTY = 128
SELF_SHADOW_COSINE = 0.2
"""of a ray and its surface: below it a ray starts no farther out than with it, for what lies there may be
another surface"""
# Each at most the sum of those before plus one: no gaps, even at a border.
_GROWTHS = (1, 2, 4, 8, 16)


def cells_at(points: torch.Tensor, count: int) -> torch.Tensor:
    """Cells [...], of `count` per axis, in which box coordinates [...] lie; beyond the box, those at its
    border."""
    return (points * count).long().clamp(0, count - 1)


def values_at(grid: torch.Tensor, points: torch.Tensor) -> torch.Tensor:
    """Values [...] of a grid [K, K, K] at box points [..., 3]; beyond the box, those at its border."""
    index = cells_at(points, grid.shape[0])
    return grid[index[..., 0], index[..., 1], index[..., 2]]


def free_distance(blocked: torch.Tensor) -> torch.Tensor:
    """0 [K, K, K] (bytes) where `blocked`, else n if no cell within n − 1 cells is (largest norm)."""
    near, radius = blocked, 0
    free = (~blocked).to(torch.uint8)
    for growth in _GROWTHS:
        near = grown(near, growth)
        radius += growth
        free[~near] = radius + 1
    return free


def blocking_grid(optical_depth: torch.Tensor) -> torch.Tensor:
    """The grid for `march.grid_transmittance` of cells' optical depths [K, K, K]."""
    depths = (optical_depth * DEPTHS_PER_UNIT).round().clamp(0, EMPTY - 1).to(torch.uint8)
    return torch.where(depths > 0, depths, EMPTY + free_distance(depths > 0))


def optical_depths(blocking: torch.Tensor) -> torch.Tensor:
    """Optical depths [K, K, K] of a grid made by `blocking_grid`."""
    return torch.where(blocking < EMPTY, blocking.float() / DEPTHS_PER_UNIT, 0.0)


def dilated(filled: torch.Tensor, cells: int) -> torch.Tensor:
    """A boolean grid [K, K, K] grown by `cells` cells in all directions, diagonals included."""
    for _ in range(cells):
        filled = grown(filled, 1)
    return filled


def grown(filled: torch.Tensor, cells: int) -> torch.Tensor:
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
