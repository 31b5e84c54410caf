"""A step's random choices, on the fastest path at hand: which samples of a ray are shaded, and which
secondary rays leave from them. No gradients.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from . import drawing_torch
from .backend import has_kernels, kernels
from .flat_form import offsets_of, room_for
from .hashing import Stream, stream_for
from .march import MOST_SAMPLES

SAMPLE_BITS = MOST_SAMPLES.bit_length() - 1
"""of a sample's key say where along its ray it is; the others are its ray's"""
RAYS_PER_SAMPLE = 1024
"""room for the secondary rays of a sample in a key"""
LEAST_SCORE = 1e-30
"""of all rays together, so that none is divided by nothing"""


class Plan(NamedTuple):
    """Which secondary rays are to be sampled: ray k belongs to sample `sample[k]`."""

    counts: Tensor  # [S] long, rays of a sample
    together: Tensor  # [S] long, rays of all samples along the same primary ray
    offsets: Tensor  # [S + 1] long, where they begin
    sample: Tensor  # [K] long
    keys: Tensor  # [K] long
    share: Tensor  # [S] by how much a ray counts
    u: Tensor  # [K, 2] uniform in [0, 1)


def draw_depths(
    weights: Tensor, offsets: Tensor, opacity: Tensor, u: Tensor, least: float
) -> tuple[Tensor, Tensor, Tensor]:
    """D samples of each ray, drawn independently by weight: which ones [K], ascending, their rays, and
    how often each was drawn.

    Args:
        weights: [S] in flat form; those of ray r are `offsets[r]:offsets[r + 1]`. opacity: [R], their
            sums; rays with no more than `least` get none. u: [R, D] uniform in [0, 1).
    """
    if not has_kernels(weights.device):
        return drawing_torch.draw_depths(weights, offsets, opacity, u, least)
    rows, row_times = offsets.new_empty(2, *u.shape).unbind()
    counts = torch.empty_like(offsets[1:])
    run = kernels("drawing", weights.device)
    run.draw_depths(
        weights.contiguous(), offsets, opacity.contiguous(), u.contiguous(), least, rows, row_times, counts
    )
    ends, total = offsets_of(counts)
    index = room_for(offsets, total, fill=len(weights) - 1)
    ray, times = room_for(offsets, 2, total).unbind()
    run.flatten(rows, row_times, ends, index, times, ray)
    return index, ray, times


def plan_rays(
    keys: Tensor, mass: Tensor, rays: int, points: Tensor, streams: tuple[Stream, Stream]
) -> Plan:
    """Share out a primary ray's `rays` among the samples along it.

    Args:
        keys: [S] long, those of a primary ray in a row. mass: [S] by how much of it each sample stands for.
        points: [P, 2] low-discrepancy in [0, 1)²; a primary ray's get the first ones, turned.
        streams: the hash's seeds for how many rays the samples get, and for that turn.
    """
    if not has_kernels(keys.device):
        parts = drawing_torch.plan_rays(keys, mass, rays, points, streams, SAMPLE_BITS, RAYS_PER_SAMPLE)
        return Plan(*parts)
    counts, together, share = torch.empty_like(keys), torch.empty_like(keys), torch.empty_like(mass)
    run = kernels("drawing", keys.device)
    streams = [stream_for(keys.device, stream) for stream in streams]
    run.share_out(keys, mass, rays, streams[0], SAMPLE_BITS, counts, share)
    offsets, total = offsets_of(counts)
    sample = room_for(keys, total, fill=len(keys) - 1)
    ray_keys, u = room_for(keys, total), room_for(mass, total, 2, fill=0.5)
    run.leave(
        keys, offsets, streams[1], points, SAMPLE_BITS, RAYS_PER_SAMPLE, sample, ray_keys, u, together
    )
    return Plan(counts, together, offsets, sample, ray_keys, share, u)


def choose_blocked(
    weights: Tensor, passing: Tensor, mass: Tensor, sample: Tensor, clear: float, budget: int, u: Tensor
) -> tuple[Tensor, Tensor]:
    """About `budget` rays by what their blockers may send, and their probabilities, in one kernel for the
    CPU; `render.reflection` has the plain twin.

    Args:
        weights: [K, 3]. passing: [K] what gets past blockers; rays with at least `clear` have none.
        mass: [S] of samples. sample: [K] long. u: [1] uniform in [0, 1).
    """
    weights = weights.detach().contiguous()
    indices, scores = torch.empty_like(sample), torch.empty_like(passing)
    probability = torch.empty_like(passing)
    count = kernels("drawing", weights.device).choose(
        weights, passing, mass, sample, clear, LEAST_SCORE, budget, float(u), scores, indices, probability
    )
    return indices[:count], probability[:count]
