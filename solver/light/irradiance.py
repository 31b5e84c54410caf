"""Diffuse light: irradiance by degree-2 spherical harmonics, of all the light or of what gets through.

Ramamoorthi & Hanrahan, "An Efficient Representation for Irradiance Environment Maps", 2001. For a point
that does not see all of the light, the sphere is cut in patches: E(n) = Σ_j V_j ∫_j L(ω) A(n, ω) dω, with
the visibility V_j of patch j and the clamped cosine A as its first three bands of harmonics. Seen from
one point this is again nine coefficients a channel, and linear in the light.

Patches overlap. What shadows tell of the light, they tell of whole patches, whose edges, were they sharp,
would be seen in a light that is fitted.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor

from ..kernels.backend import precise
from ..kernels.integral import corner_sums
from ..kernels.integral_torch import prefix_sums
from .spherical_harmonics import quadratic, quadratic_form, sh_basis

COSINE_LOBE = (math.pi, *[2 * math.pi / 3] * 3, *[math.pi / 4] * 5)
"""of the clamped cosine, per coefficient up to degree 2"""
PATCH_ROWS = 16
"""rows of patches from pole to pole, 11° each"""
_SHIFTS = (-0.25, 0.25)
"""shares of its size by which the rectangles are shifted, either way, whose mean a patch is"""
_SAMPLES = 8  # along either edge of such a rectangle, for means over it


class Patches(NamedTuple):
    """J patches of the sphere of directions, of about equal size, row by row from +Z."""

    solid_angle: Tensor  # [J] sr
    lobes: Tensor  # [J, 9] mean over the patch of harmonics × the clamped cosine's


class Arriving(NamedTuple):
    """What R points see of the light: see `Patches`."""

    passing: Tensor  # [R, J] share of each patch's light
    lobes: Tensor  # [J, 9] as `Patches.lobes`, or where the light is in the patch
    sent: Tensor  # [R, 9, 3] coefficients of the irradiance by what stands before the others


@lru_cache(maxsize=4)
def patches(device: torch.device) -> Patches:
    """The patches that all lights and points share."""
    inner = (torch.arange(_SAMPLES, dtype=torch.float64) + 0.5) / _SAMPLES
    top, bottom, left, right = _sides()[..., None].unbind(-2)
    high, low = (torch.cos(math.pi * side) for side in (top, bottom))
    z = (high + (low - high) * inner)[..., :, None]  # even in z is even in solid angle
    turn = (math.pi - 2 * math.pi * (left + (right - left) * inner))[..., None, :]
    level = (1 - z * z).sqrt()
    points = torch.stack(torch.broadcast_tensors(level * turn.cos(), level * turn.sin(), z), -1)
    size = ((high - low) * 2 * math.pi * (right - left))[..., 0]
    means = sh_basis(points, 2).mean((-3, -2)) * torch.tensor(COSINE_LOBE, dtype=torch.float64)
    lobes = (means * size[..., None]).sum(0) / size.sum(0)[:, None]
    return Patches(size.mean(0).float().to(device), lobes.float().to(device))


@lru_cache(maxsize=1)
def _sides() -> Tensor:
    """Top, bottom, left, right [4, J, 4] of the four rectangles whose mean a patch is, as shares of a map's
    height and width; some reach over its left or right edge."""
    return torch.stack([_shifted(down, across) for down in _SHIFTS for across in _SHIFTS])


def _columns() -> list[int]:
    """Patches of each row."""
    middles = (math.sin((row + 0.5) * math.pi / PATCH_ROWS) for row in range(PATCH_ROWS))
    return [max(4, round(2 * PATCH_ROWS * sine)) for sine in middles]


def patches_at(directions: Tensor) -> Tensor:
    """In which patch [N] unit directions [N, 3] of the world lie; where patches overlap, in its middle."""
    x, y, z = directions.unbind(-1)
    counts = torch.tensor(_columns(), device=x.device)
    row = (torch.acos(z.clamp(-1, 1)) * (PATCH_ROWS / math.pi)).long().clamp(max=PATCH_ROWS - 1)
    turn = 0.5 - torch.atan2(y, x) / (2 * math.pi)
    count = counts[row]
    column = (turn * count).long().clamp(min=0)
    return (counts.cumsum(0) - counts)[row] + torch.minimum(column, count - 1)


def _shifted(down: float, across: float) -> Tensor:
    """Sides [J, 4] of a rectangle of every patch, shifted by shares of a patch's size; the poles stay."""
    sides = []
    for row, count in enumerate(_columns()):
        top, bottom = ((edge + down * (0 < edge < PATCH_ROWS)) / PATCH_ROWS for edge in (row, row + 1))
        for column in range(count):
            sides.append([top, bottom, (column + across) / count, (column + 1 + across) / count])
    return torch.tensor(sides, dtype=torch.float64)


class _Corners(NamedTuple):
    """Where prefix sums [(H + 1) · (2H + 1)] of a map are summed up to make those over patches."""

    at: Tensor  # [J, 24] long
    share: Tensor  # [J, 24]


@lru_cache(maxsize=16)
def _corners(height: int, device: torch.device) -> _Corners:
    """Corners of the patches' rectangles, which end at whole texels: no texel is split."""
    width = 2 * height
    top, bottom, left, right = _sides().unbind(-1)
    at, share = [], []
    for row, down in ((bottom, 1), (top, -1)):
        first = (row * height).round().long() * (width + 1)
        around = torch.zeros_like(first)
        for column, across in ((right, 1), (left, -1)):
            column = (column * width).round().long()
            # Prefix sums go on beyond the map: once around adds what the whole row holds.
            turns = column.div(width, rounding_mode="floor")
            at.append(first + column - turns * width)
            share.append(torch.full_like(turns, down * across))
            around += across * turns
        at.append(first + width)
        share.append(down * around)
    at, share = (torch.cat(values).T.contiguous() for values in (at, share))
    return _Corners(at.to(device), share.to(device, precise(device)) / len(top))


def power(table: Tensor) -> Tensor:
    """∫ L dω [J, 3] over every patch, of a light's prefix sums [H+1, W+1, 3] (`LightTables.table`)."""
    corners = _corners(len(table) - 1, table.device)
    rows = table.flatten(0, 1)
    return corner_sums(rows, corners.at, corners.share).float()


def bright_lobes(harmonics: Tensor, radiance: Tensor) -> Tensor:
    """`Patches.lobes` [J, 9] weighted by the light in each patch: a sun is where it is.

    Args:
        harmonics: [9, H·W] harmonics × the clamped cosine's × the texels' solid angles. radiance: [H·W].
    """
    lobes = patches(radiance.device).lobes
    height = math.isqrt(len(radiance) // 2)
    weighted = (harmonics * radiance).view(-1, height, 2 * height)
    if precise(radiance.device) != torch.float64:
        # Of a dark patch beside a sun, single precision leaves noise, and that may have no direction.
        weighted = weighted.cpu()
    sums = power(prefix_sums(weighted, weighted.new_ones(height, dtype=torch.float64)))
    sums = sums.to(radiance.device)
    whole = sums[:, :1] / lobes[:, :1]
    return torch.where(whole > 0, sums / whole.clamp(min=1e-30), lobes)


def middles(lobes: Tensor) -> Tensor:
    """The mean directions [J, 3] of lobes [J, 9], unit, world: what their first band says."""
    return F.normalize(lobes[:, [3, 1, 2]], dim=-1)


def arriving_harmonics(table: Tensor, arriving: Arriving) -> Tensor:
    """Coefficients [R, 9, 3] of the irradiance at R points, linear in the light.

    Args:
        table: the light's prefix sums [H+1, W+1, 3].
    """
    lit = power(table)[:, None, :] * arriving.lobes[..., None]
    return (arriving.passing @ lit.flatten(1)).view(-1, *lit.shape[1:]) + arriving.sent


def irradiance(harmonics: Tensor, normals: Tensor) -> Tensor:
    """Irradiance [N, 3] of surfaces with unit normals [N, 3], of its coefficients [9, 3], or [N, 9, 3]
    where every surface has its own."""
    basis = quadratic(normals) @ quadratic_form(normals.device, normals.dtype)
    if harmonics.dim() == 2:
        return (basis @ harmonics).clamp(min=0)
    return torch.einsum("nl,nlc->nc", basis, harmonics).clamp(min=0)
