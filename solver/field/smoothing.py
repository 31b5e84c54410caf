"""Gaussian-smoothed finite differences of VM factors (paper §3.1, "smoothed normals").

Smoothing the field in 3-D by a separable Gaussian and differentiating it is the same as smoothing
and differentiating the factors: ∂x(G ∗ P·L) = (∂x G ∗ P)·(G ∗ L). Lines get the 1-D marginal of the
kernel (the authors' public code damps them by 0.452 instead).
"""

import math
from collections.abc import Callable

import torch
import torch.nn.functional as F
from torch import Tensor

from ..kernels.vm import smooth_lines, smooth_planes

PAPER_TAPS = torch.tensor([0.274068619, 0.451862762, 0.274068619])
"""the paper's kernel: a Gaussian of σ = 1 voxel, cut off after one"""
PAPER_SIGMA = (2 * float(PAPER_TAPS[0])) ** 0.5
"""its standard deviation once cut off, voxels"""
LEAST_STEP_SIGMA = 1 / 3
"""voxels; narrower than that, a Gaussian on the grid does nothing"""


def gaussian_taps(sigma: float) -> Tensor:
    """A Gaussian of standard deviation `sigma` voxels, up to three of them; at least `PAPER_TAPS`."""
    if sigma <= PAPER_SIGMA:
        return PAPER_TAPS
    return gaussian(sigma)


def gaussian(sigma: float) -> Tensor:
    """Taps of a Gaussian of standard deviation `sigma`, up to three of them; their sum is 1."""
    reach = math.ceil(3 * sigma)
    taps = torch.exp(-0.5 * (torch.arange(-reach, reach + 1) / sigma) ** 2)
    return taps / taps.sum()


def smoothed_factors(planes: Tensor, lines: Tensor, taps: Tensor = PAPER_TAPS) -> tuple[Tensor, Tensor]:
    """Factors of `vm_gradient`: planes [3, G, G, C] and lines [3, G, C], each smoothed along its axes."""
    return smooth_planes(planes, taps), smooth_lines(lines, taps)


def step_smoothing(sigma: float) -> Callable[[Tensor], Tensor] | None:
    """What smooths a change of planes or lines by a Gaussian of `sigma` voxels; None below a third.

    A fit whose every step is smooth finds smooth surfaces first and bends them only where the photos
    insist; Adam alone makes steps of one size everywhere, also where there is but noise to follow.
    Nicolet et al., "Large Steps in Inverse Rendering of Geometry", 2021 (doi:10.1145/3478513.3480501),
    do so for meshes.
    """
    if sigma < LEAST_STEP_SIGMA:
        return None
    taps = gaussian(sigma)
    return lambda change: smooth_planes(change, taps) if change.dim() == 4 else smooth_lines(change, taps)


def upsample(planes: Tensor, lines: Tensor, size: int):
    """Factors on a finer grid of `size` nodes per axis, by linear interpolation (corners fixed)."""
    channels_first = planes.permute(0, 3, 1, 2)
    planes = F.interpolate(channels_first, size=(size, size), mode="bilinear", align_corners=True)
    lines = F.interpolate(lines.permute(0, 2, 1), size=size, mode="linear", align_corners=True)
    return planes.permute(0, 2, 3, 1).contiguous(), lines.permute(0, 2, 1).contiguous()
