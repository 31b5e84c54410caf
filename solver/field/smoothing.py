"""Gaussian-smoothed finite differences of VM factors (paper §3.1, "smoothed normals").

Smoothing the field in 3-D by a separable Gaussian and differentiating it is the same as smoothing
and differentiating the factors: ∂x(G ∗ P·L) = (∂x G ∗ P)·(G ∗ L). Lines get the 1-D marginal of the
kernel (the authors' public code damps them by 0.452 instead).
"""

from __future__ import annotations

import torch
import torch.nn.functional as F

from ..kernels.vm import smooth_planes
from ..kernels.vm_torch import correlate

SMOOTHING = (0.274068619, 0.451862762, 0.274068619)  # a Gaussian of σ = 1 voxel on three taps


def smoothed_factors(
    planes: torch.Tensor, lines: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Factors of `vm_gradient`: planes [3, G, G, C] and lines [3, G, C], each smoothed along its axes."""
    side, centre, _ = SMOOTHING
    return smooth_planes(planes, centre, side), correlate(lines, SMOOTHING, 1)


def upsample(planes: torch.Tensor, lines: torch.Tensor, size: int):
    """Factors on a finer grid of `size` nodes per axis, by linear interpolation (corners fixed)."""
    channels_first = planes.permute(0, 3, 1, 2)
    planes = F.interpolate(channels_first, size=(size, size), mode="bilinear", align_corners=True)
    lines = F.interpolate(lines.permute(0, 2, 1), size=size, mode="linear", align_corners=True)
    return planes.permute(0, 2, 3, 1).contiguous(), lines.permute(0, 2, 1).contiguous()
