"""Gaussian-smoothed finite differences of VM factors (paper §3.1, "smoothed normals").

Smoothing the field in 3-D by a separable Gaussian and differentiating it is the same as smoothing
and differentiating the factors: ∂x(G ∗ P·L) = (∂x G ∗ P)·(G ∗ L). Lines get the 1-D marginal of the
kernel (the authors' public code damps them by 0.452 instead).
"""

from __future__ import annotations

import torch
import torch.nn.functional as F

SMOOTHING = (0.274068619, 0.451862762, 0.274068619)  # a Gaussian of σ = 1 voxel on three taps


def _correlate(factor: torch.Tensor, taps: tuple[float, ...], axis: int) -> torch.Tensor:
    """Correlation along one axis; the borders continue with their last value."""
    radius = len(taps) // 2
    size = factor.shape[axis]
    first, last = factor.narrow(axis, 0, 1), factor.narrow(axis, size - 1, 1)
    padded = torch.cat([first] * radius + [factor] + [last] * radius, dim=axis)
    total = None
    for offset, tap in enumerate(taps):
        if tap != 0.0:
            term = padded.narrow(axis, offset, size) * tap
            total = term if total is None else total + term
    return total


def smooth(factor: torch.Tensor, axis: int) -> torch.Tensor:
    """Gaussian smoothing along one axis."""
    return _correlate(factor, SMOOTHING, axis)


def difference(factor: torch.Tensor, axis: int) -> torch.Tensor:
    """Central difference per grid unit along one axis."""
    return _correlate(factor, (-0.5, 0.0, 0.5), axis)


def smoothed_factors(
    planes: torch.Tensor, lines: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Factors of `vm_gradient`: planes [3, G, G, C] → [3, G, G, 3, C], lines [3, G, C] → [3, G, 2, C].

    Plane entries: smoothed value, its derivative along the first, along the second axis. Line
    entries: smoothed value, its derivative.
    """
    along_a = smooth(planes, 1)
    value = smooth(along_a, 2)
    plane_stack = torch.stack([value, difference(value, 1), difference(value, 2)], dim=3)
    line = smooth(lines, 1)
    return plane_stack, torch.stack([line, difference(line, 1)], dim=2)


def upsample(planes: torch.Tensor, lines: torch.Tensor, size: int):
    """Factors on a finer grid of `size` nodes per axis, by linear interpolation (corners fixed)."""
    channels_first = planes.permute(0, 3, 1, 2)
    planes = F.interpolate(channels_first, size=(size, size), mode="bilinear", align_corners=True)
    lines = F.interpolate(lines.permute(0, 2, 1), size=size, mode="linear", align_corners=True)
    return planes.permute(0, 2, 3, 1).contiguous(), lines.permute(0, 2, 1).contiguous()
