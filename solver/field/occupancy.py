"""Where there is anything: the occupancy grid that lets rays skip empty space."""

import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from ..kernels.skipping import blocking_grid, cells_at, dilated, free_distance, of_corners, values_at
from .field import MicrofacetField

LEAST_PASSING = 1e-9
"""of the light on an opaque cell"""


class Occupancy(nn.Module):
    """Grids over the field's box: which of its cells [K, K, K] may be occupied, and how much what is at
    their corners [K + 1, K + 1, K + 1] dims along the edge of a cell.

    A cell is occupied if any of its eight corners is denser than a threshold, or a neighbour is:
    one cell of dilation lets a surface move between refreshes, so geometry that was rejected once
    can come back. Nothing outside `allowed` ever counts as occupied.
    """

    def __init__(self, cells: int, device: torch.device | str = "cpu"):
        super().__init__()
        everywhere = torch.ones(cells, cells, cells, dtype=torch.bool, device=device)
        self.register_buffer("occupied", everywhere, persistent=False)
        nothing = torch.zeros((cells + 1,) * 3, device=device)
        self.register_buffer("corner_depth", nothing, persistent=False)
        self.register_buffer("free", free_distance(everywhere), persistent=False)
        self.register_buffer("blocking", blocking_grid(nothing), persistent=False)
        self.register_buffer("allowed", everywhere.clone(), persistent=False)

    @property
    def cells(self) -> int:
        return self.occupied.shape[0]

    @torch.no_grad()
    def refresh(self, field: MicrofacetField, min_alpha: float, step: float, dilation: int) -> None:
        """Re-evaluate the density at all cell corners.

        Args:
            min_alpha: opacity of one `step` (world units) from which a corner counts as occupied.
            dilation: cells by which the occupied set grows.
        """
        sigma = field.extinction(field.raw_density_grid(self.cells + 1))
        occupied = of_corners(sigma > -math.log1p(-min_alpha) / step, torch.logical_or)
        occupied = dilated(occupied, dilation)
        cell = 2 * field.half_size / self.cells
        self.fill(occupied & self.allowed, sigma * cell)

    def fill(self, occupied: Tensor, corner_depth: Tensor) -> None:
        """Take over a boolean grid of what may be occupied, and optical depths at corners, which count
        where something may be."""
        self.occupied, self.corner_depth = occupied, corner_depth * self._allowed_corners()
        self.free, self.blocking = free_distance(occupied), blocking_grid(self.corner_depth)

    def optical_depth(self) -> Tensor:
        """Optical depths [K, K, K] of cells whose eighths are as deep as their corners, side by side.

        A mean of depths would do for fog, but of a cell at a body's edge one dense corner would make it all
        opaque.
        """
        passing = of_corners(torch.exp(-self.corner_depth), torch.add) / 8
        return -torch.log(passing.clamp(min=LEAST_PASSING, max=1.0))

    def _allowed_corners(self) -> Tensor:
        """True [K + 1, K + 1, K + 1] where nothing that is not allowed is beside a corner."""
        forbidden = F.pad((~self.allowed)[None, None].float(), (1,) * 6)
        return F.max_pool3d(forbidden, 2, 1)[0, 0] == 0

    def is_allowed(self, box_points: Tensor) -> Tensor:
        """True [N] where something may be, at box points [N, 3]."""
        return values_at(self.allowed, box_points)

    def allowed_grid(self, count: int) -> Tensor:
        """`is_allowed` [K, K, K] at `count` nodes per axis, from face to face of the box."""
        ticks = torch.linspace(0, 1, count, device=self.allowed.device)
        index = cells_at(ticks, len(self.allowed))
        return self.allowed[index][:, index][:, :, index]

    def allow_only(self, grid: Tensor, dilation: int) -> None:
        """Restrict to a boolean grid [H, H, H] over the same box, grown by `dilation` of its cells.

        Where masks say that there is nothing, no floater can settle.
        """
        grown = dilated(grid.cpu(), dilation)[None, None].float()
        resized = (
            F.adaptive_max_pool3d(grown, self.cells)
            if len(grid) >= self.cells
            else F.interpolate(grown, size=(self.cells,) * 3, mode="nearest")
        )
        self.allowed = (resized[0, 0] > 0).to(self.occupied.device)
