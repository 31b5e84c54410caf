"""Plain torch twin of `drawing`'s kernels: the same choices, bit for bit where nothing is summed."""

from __future__ import annotations

import torch

from .backend import precise
from .hashing import uniform


def draw_depths(weights, offsets, opacity, u, least):
    """See `drawing.draw_depths`."""
    running = weights.to(precise(weights.device)).cumsum(0)
    last = (offsets[1:] - 1).clamp(min=0)
    active = (opacity > least) & (offsets[1:] > offsets[:-1])
    rows = active.nonzero()[:, 0]
    end = running[last[rows]]
    start = running[offsets[rows]] - weights[offsets[rows]]
    target = start[:, None] + u[rows].to(running.dtype) * (end - start)[:, None]
    found = torch.searchsorted(running, target, right=True)
    found = torch.minimum(torch.maximum(found, offsets[rows, None]), last[rows, None])
    index, times = torch.unique(found, return_counts=True)
    return index, torch.searchsorted(offsets, index, right=True) - 1, times


def allocate_rays(weights: torch.Tensor, rays: int, u: torch.Tensor) -> torch.Tensor:
    """How many of a pixel's `rays` each sample gets: floor(w·M + u), unbiased for u ~ U[0, 1).

    The paper's floor(w·M) leaves every sample with w < 1/M without any (errata).
    """
    return (weights * rays + u).floor().long()


def plan_rays(keys, mass, rays, points, streams, keys_per_sample):
    """See `drawing.plan_rays`; the parts of a plan."""
    expected = mass * rays
    counts = allocate_rays(mass, rays, uniform(keys, streams[0], 1)[:, 0])
    offsets = torch.nn.functional.pad(counts.cumsum(0), (1, 0))
    sample = torch.repeat_interleave(torch.arange(len(counts), device=counts.device), counts)
    index = torch.arange(len(sample), device=counts.device) - offsets[sample]
    # A sample that was lucky to get its one ray stands for the others like it.
    share = (mass > 0) / (expected.clamp(1e-6, 1) * counts.clamp(min=1))
    ray_keys = keys[sample] * keys_per_sample + index % keys_per_sample
    return counts, offsets, sample, ray_keys, share, turned(points, keys, streams[1], sample, index)


def turned(points, keys, stream, sample, index):
    """Points [K, 2] for ray number `index` [K] of sample `sample` [K]; `keys` [S] name the samples.

    The first N points of one scrambled Sobol set, shifted on the torus for every sample by an offset
    from all of [0, 1)² (Cranley & Patterson 1976; the public code shifts by a quarter at most, so
    that a sample's one ray is biased).
    """
    shifted = points[index % len(points)] + uniform(keys, stream, 2)[sample]
    return shifted - shifted.floor()
