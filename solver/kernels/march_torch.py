"""Plain torch twin of `march_numba`: dense, slow, readable, on any device."""

import torch
import torch.nn.functional as F
from torch import Tensor

from .backend import precise
from .skipping import between_corners, roots_of, values_at
from .vm_torch import vm_sum


def box_span(origins: Tensor, directions: Tensor) -> tuple[Tensor, Tensor]:
    """Entry and exit distances [R] of rays [R, 3] through [0, 1]^3; entry > exit if they miss."""
    parallel = directions.abs() < 1e-12
    safe = torch.where(parallel, torch.ones_like(directions), directions)
    t0, t1 = -origins / safe, (1 - origins) / safe
    near = torch.where(parallel, torch.full_like(t0, -1e30), torch.minimum(t0, t1)).amax(-1)
    far = torch.where(parallel, torch.full_like(t0, 1e30), torch.maximum(t0, t1)).amin(-1)
    missed = (parallel & ((origins < 0) | (origins > 1))).any(-1)
    return torch.where(missed, 1.0, near), torch.where(missed, 0.0, far)


def march(
    origins, directions, start, jitter, step, cell, free, planes, lines, shift, scale,
    min_transmittance, capacity,
):  # fmt: skip
    """See `march_numba.march`; returns flat distances, raw densities, points, ray indices, offsets."""
    near, far = box_span(origins, directions)
    near = torch.maximum(near, start)
    most = int(torch.ceil(((far - near).clamp(min=0) / step).max()).item()) + 1 if len(near) else 0
    t = near[:, None] + (torch.arange(most, device=near.device) + jitter[:, None]) * step
    points = origins[:, None] + t[..., None] * directions[:, None]
    inside = (t < far[:, None]) & (values_at(free, points) == 0)
    raw = torch.zeros_like(t)
    nodes = planes.shape[1] - 1
    raw[inside] = vm_sum(points[inside] * nodes, planes, lines)
    depth = scale * F.softplus(raw + shift) * step
    depth = torch.where(inside, depth, torch.zeros_like(depth))
    before = torch.exp(-(torch.cumsum(depth, -1) - depth))
    inside &= before >= min_transmittance
    inside &= torch.cumsum(inside.long(), -1) <= capacity
    counts = inside.sum(-1)
    offsets = torch.cat([counts.new_zeros(1), counts.cumsum(0)])
    ray = torch.arange(len(near), device=near.device).repeat_interleave(counts)
    return t[inside], raw[inside], points[inside], ray, offsets


def grid_transmittance(origins, directions, start, step, blocking) -> Tensor:
    """See `march_numba.grid_transmittance`."""
    _, depth = through_grid(origins, directions, start, step, roots_of(blocking))
    return torch.exp(-depth.sum(-1))


def through_grid(origins, directions, start, step, roots) -> tuple[Tensor, Tensor]:
    """Distances and optical depths [R, T] of the steps of rays through a grid of corners' roots."""
    near, far = box_span(origins, directions)
    near = torch.maximum(near, start)
    most = int(torch.ceil(((far - near).clamp(min=0) / step).max()).item()) + 1 if len(near) else 0
    t = near[:, None] + torch.arange(most, device=near.device) * step
    points = origins[:, None] + t[..., None] * directions[:, None]
    return t, torch.where(t < far[:, None], between_corners(roots, points).square(), 0.0)


def composite(optical_depth: Tensor, offsets: Tensor):
    """Weights [S] and remaining transmittance [R] of flat segments of optical depths [S]."""
    counts = offsets[1:] - offsets[:-1]
    ray = torch.arange(len(counts), device=counts.device).repeat_interleave(counts)
    total = torch.zeros(len(counts), dtype=optical_depth.dtype, device=optical_depth.device)
    total = total.index_add(0, ray, optical_depth)
    # One running sum over all rays: in single precision its differences would lose their digits.
    running = torch.cat([optical_depth.new_zeros(1), optical_depth])
    running = running.to(precise(optical_depth.device)).cumsum(0)
    before = running[:-1] - running[offsets[:-1].clamp(max=len(running) - 1)][ray]
    before = before.to(optical_depth.dtype)
    weights = torch.exp(-before) * -torch.expm1(-optical_depth)
    return weights, torch.exp(-total)
