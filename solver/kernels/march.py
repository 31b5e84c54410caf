"""Walking rays and compositing along them, on the fastest path at hand.

Rays are given in box units (see `march_numba`); distances and steps are in world units.
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from . import march_torch
from .backend import fast, kernels
from .flat_form import filled_up, offsets_of, room_for

MOST_SAMPLES = 4096
"""of a ray; what lies beyond them is not seen"""


class Segments(NamedTuple):
    """Samples of R rays in flat form: those of ray r are `offsets[r]:offsets[r + 1]`."""

    distance: Tensor  # [S] world units
    raw: Tensor  # [S] raw densities there, no gradient
    points: Tensor  # [S, 3] box units, no gradient
    ray: Tensor  # [S] long
    offsets: Tensor  # [R + 1] long


def march(
    origins: Tensor, directions: Tensor, start: Tensor, jitter: Tensor,
    step: float, cell: float, free: Tensor, planes: Tensor, lines: Tensor,
    shift: float, scale: float, min_transmittance: float = 1e-3,
) -> Segments:  # fmt: skip
    """Sample rays [R, 3] where `free` [K, K, K] is 0, up to the first opaque point.

    Args:
        start: [R] distance before which nothing is sampled.
        jitter: [R] offset of the samples in steps, in [0, 1).
        cell: edge of a cell of `free`, in the unit of distances. free: see `skipping`.
        planes, lines: density factors (`vm_torch`), used for the early stop; no gradient.
        shift, scale: σ = scale · softplus(raw + shift) per world unit.
    """
    planes, lines = planes.detach(), lines.detach()
    # Of the box's diagonal, which no ray is longer than.
    capacity = min(math.ceil(math.sqrt(3.0) * cell * len(free) / step) + 2, MOST_SAMPLES)
    if not fast(planes):
        return Segments(*march_torch.march(
            origins, directions, start, jitter, step, cell, free, planes, lines, shift, scale,
            min_transmittance, capacity,
        ))  # fmt: skip
    origins, directions = origins.contiguous(), directions.contiguous()
    rays, run = len(origins), kernels("march", origins.device)
    distance, raw = origins.new_empty(2, rays, capacity).unbind()
    counts = torch.empty(rays, dtype=torch.long, device=origins.device)
    run.march(
        origins, directions, start.contiguous(), jitter.contiguous(), step, cell, free,
        planes.contiguous(), lines.contiguous(), shift, scale, min_transmittance, distance, raw, counts,
    )  # fmt: skip
    offsets, count = offsets_of(counts)
    flat, flat_raw = room_for(origins, 2, count).unbind()
    points, ray = room_for(origins, count, 3), room_for(counts, count)
    run.compact(origins, directions, distance, raw, offsets, flat, flat_raw, points, ray)
    return Segments(*filled_up(offsets, flat, flat_raw, points, ray), offsets)


def grid_transmittance(
    origins: Tensor, directions: Tensor, start: Tensor, step: float, blocking: Tensor
) -> Tensor:
    """Transmittance [R] through a coarse grid (`skipping.blocking_grid`); no gradient.

    Args:
        step: edge of the grid's cells, in the unit of distances.
    """
    if not fast(origins):
        return march_torch.grid_transmittance(origins, directions, start, step, blocking)
    out = origins.new_empty(len(origins))
    kernels("march", origins.device).grid_transmittance(
        origins.contiguous(), directions.contiguous(), start.contiguous(), step, blocking, out
    )
    return out


class _Composite(torch.autograd.Function):
    @staticmethod
    def forward(ctx, optical_depth, offsets):
        weights = room_for(optical_depth, len(optical_depth))
        transmittance = weights.new_empty(len(offsets) - 1)
        run = kernels("march", weights.device)
        run.composite(optical_depth, offsets, weights, transmittance)
        ctx.save_for_backward(offsets, weights, transmittance)
        return weights, transmittance

    @staticmethod
    def backward(ctx, g_weights, g_transmittance):
        offsets, weights, transmittance = ctx.saved_tensors
        out = room_for(weights, len(weights))
        kernels("march", weights.device).composite_backward(
            offsets, weights, transmittance, g_weights.contiguous(), g_transmittance.contiguous(), out
        )
        return out, None


def composite(optical_depth: Tensor, offsets: Tensor) -> tuple[Tensor, Tensor]:
    """Volume rendering weights w_i = T_i (1 − exp(−σ_i δ_i)) [S] and what passes each ray [R]."""
    if fast(optical_depth):
        return _Composite.apply(optical_depth.contiguous(), offsets)
    return march_torch.composite(optical_depth, offsets)
