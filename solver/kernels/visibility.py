"""What light gets through a coarse grid to points in it, on the fastest path at hand. No gradients."""

from torch import Tensor

from . import visibility_torch
from .backend import fast, kernels


def look_around(
    points: Tensor, directions: Tensor, start: float, step: float, blocking: Tensor
) -> tuple[Tensor, Tensor]:
    """Transmittances [P, J] between P points and what lies far away in J directions, and the distances
    [P, J] at which half of the light is stopped (infinite where it is not).

    Args:
        points: [P, 3] box units. directions: [J, 3] box units per unit of distance.
        start: distance before which nothing blocks. step: edge of the grid's cells.
        blocking: see `skipping.blocking_grid`.
    """
    if not fast(points):
        return visibility_torch.look_around(points, directions, start, step, blocking)
    passing, distance = points.new_empty(2, len(points), len(directions)).unbind()
    kernels("visibility", points.device).look_around(
        points.contiguous(), directions.contiguous(), start, step, blocking, passing, distance
    )
    return passing, distance
