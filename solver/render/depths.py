"""Which of a ray's density samples are shaded, and for how much of its pixel each one stands."""

from __future__ import annotations

from typing import NamedTuple

import torch


class Depths(NamedTuple):
    """K chosen samples."""

    index: torch.Tensor  # [K] long, ascending
    weight: torch.Tensor  # [K] of what the sample shows; gradient to the density
    mass: torch.Tensor  # [K] share of the pixel that the sample stands for, no gradient


def heavy_depths(weights: torch.Tensor, ray: torch.Tensor, rays: int, min_weight: float) -> Depths:
    """All samples [S] heavier than `min_weight`; the others of `ray` [S] long are made up for."""
    with torch.no_grad():
        index = (weights > min_weight).nonzero()[:, 0]
        kept = ray[index]
        total = torch.zeros(rays, device=weights.device).index_add(0, ray, weights)
        heavy = torch.zeros_like(total).index_add(0, kept, weights[index])
        factor = (total / heavy.clamp(min=1e-6)).clamp(max=2.0)[kept]
    return Depths(index, weights[index] * factor, weights.detach()[index])


def random_depths(
    weights: torch.Tensor, offsets: torch.Tensor, ray: torch.Tensor, depths: int, u: torch.Tensor
) -> Depths:
    """About `depths` samples a ray, by systematic sampling of its weights; unbiased.

    A sample is chosen n times with expectation depths · w and stands for n/depths of the pixel. What
    is seen is estimated by Σ n/(depths · w) · w · L over the chosen, whose gradient with respect to
    the weights has the right expectation too.

    Args:
        weights: [S] in flat form; those of ray r are `offsets[r]:offsets[r + 1]`.
        u: [R] uniform in [0, 1).
    """
    with torch.no_grad():
        fixed = weights.detach().double()
        running = torch.nn.functional.pad(fixed.cumsum(0), (1, 0))
        start = running[offsets[:-1]]
        below = (depths * (running[:-1] - start[ray]) + u[ray]).floor()
        above = (depths * (running[1:] - start[ray]) + u[ray]).floor()
        times = above - below
        index = (times > 0).nonzero()[:, 0]
        mass = (times[index] / depths).float()
        factor = mass / weights.detach()[index].clamp(min=1e-12)
    return Depths(index, weights[index] * factor, mass)
