"""Plain torch twin of `drawing`'s kernels: the same choices, bit for bit where nothing is summed."""

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


def plan_rays(keys, mass, rays, points, streams, sample_bits, keys_per_sample):
    """See `drawing.plan_rays`; the parts of a plan."""
    primary, along, samples = torch.unique_consecutive(
        keys >> sample_bits, return_inverse=True, return_counts=True
    )
    counts, share = share_out(mass * rays, along, samples, uniform(primary, streams[0], 1)[:, 0])
    offsets = torch.nn.functional.pad(counts.cumsum(0), (1, 0))
    first, end = offsets[samples.cumsum(0) - samples], offsets[samples.cumsum(0)]
    sample = torch.repeat_interleave(torch.arange(len(counts), device=counts.device), counts)
    ray = torch.arange(len(sample), device=counts.device)
    ray_keys = keys[sample] * keys_per_sample + (ray - offsets[sample]) % keys_per_sample
    along_ray = along[sample]
    u = turned(points, uniform(primary, streams[1], 2)[along_ray], ray - first[along_ray])
    return counts, (end - first)[along], offsets, sample, ray_keys, share, u


def share_out(expected, along, samples, u):
    """How many rays each sample gets [S], and by how much each of them counts.

    Systematic sampling from u[r] ~ U[0, 1) on along primary ray r, whose `samples[r]` samples are in a row:
    in the mean each gets what it expects. With the paper's floor(w·M), those with w < 1/M never get any.

    Args:
        expected: [S]. along: [S] long, the sample's primary ray. u: [R].
    """
    steps = expected.to(precise(expected.device))
    running = steps.cumsum(0)
    first = samples.cumsum(0) - samples
    begun = (running - steps)[first] - u
    counts = (running - begun[along]).floor() - (running - steps - begun[along]).floor()
    counts = counts.long()
    # A sample that was lucky to get its one ray stands for the others like it.
    return counts, (expected > 0) / (expected.clamp(1e-6, 1) * counts.clamp(min=1))


def turned(points, shift, index):
    """Points [K, 2] number `index` [K] of one scrambled Sobol set, shifted on the torus by `shift` [K, 2].

    Shifts are from all of [0, 1)² (Cranley & Patterson 1976); with the public code's, of at most a quarter,
    a lone ray is biased.
    """
    shifted = points[index % len(points)] + shift
    return shifted - shifted.floor()
