"""Diffuse light: irradiance by degree-2 spherical harmonics, of all the light or of what gets through.

Ramamoorthi & Hanrahan, "An Efficient Representation for Irradiance Environment Maps", 2001. For a point
that does not see all of the light, the sphere is cut in patches: E(n) = Σ_j V_j ∫_j L(ω) A(n, ω) dω, with
the visibility V_j of patch j and the clamped cosine A as its first three bands of harmonics. Seen from
one point this is again nine coefficients a channel, and linear in the light.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import torch

from .spherical_harmonics import quadratic, quadratic_form, sh_basis

COSINE_LOBE = (math.pi, *[2 * math.pi / 3] * 3, *[math.pi / 4] * 5)
"""of the clamped cosine, per coefficient up to degree 2"""
PATCH_ROWS = 16
"""rows of patches from pole to pole, 11° each"""
_SAMPLES = 8  # along either edge of a patch, for means over it


class Patches(NamedTuple):
    """J patches of the sphere of directions, of about equal size, row by row from +Z."""

    sides: torch.Tensor  # [J, 4] top, bottom, left, right as shares of the map's height and width
    solid_angle: torch.Tensor  # [J] sr
    lobes: torch.Tensor  # [J, 9] mean over the patch of harmonics × the clamped cosine's


class Arriving(NamedTuple):
    """What R points see of the light: see `Patches`."""

    passing: torch.Tensor  # [R, J] share of each patch's light
    lobes: torch.Tensor  # [J, 9] as `Patches.lobes`, or where the light is in the patch
    sent: torch.Tensor  # [R, 9, 3] coefficients of the irradiance by what stands before the others


@lru_cache(maxsize=4)
def patches(device: torch.device) -> Patches:
    """The patches that all lights and points share."""
    sides, solid_angle, lobes = [], [], []
    inner = (torch.arange(_SAMPLES, dtype=torch.float64) + 0.5) / _SAMPLES
    lobe = torch.tensor(COSINE_LOBE, dtype=torch.float64)
    for row in range(PATCH_ROWS):
        count = max(4, round(2 * PATCH_ROWS * math.sin((row + 0.5) * math.pi / PATCH_ROWS)))
        top, bottom = (math.cos((row + side) * math.pi / PATCH_ROWS) for side in (0, 1))
        height = top + (bottom - top) * inner  # even in z is even in solid angle
        for column in range(count):
            turn = math.pi - 2 * math.pi * (column + inner) / count
            z, phi = torch.meshgrid(height, turn, indexing="ij")
            level = (1 - z * z).sqrt()
            points = torch.stack([level * phi.cos(), level * phi.sin(), z], -1)
            lobes.append(sh_basis(points, 2).mean((0, 1)) * lobe)
            solid_angle.append((top - bottom) * 2 * math.pi / count)
            rows, columns = (row, row + 1), (column, column + 1)
            sides.append([r / PATCH_ROWS for r in rows] + [c / count for c in columns])
    return Patches(
        torch.tensor(sides).to(device), torch.tensor(solid_angle).to(device),
        torch.stack(lobes).float().to(device),
    )  # fmt: skip


@lru_cache(maxsize=16)
def _sides(height: int, device: torch.device) -> torch.Tensor:
    """`Patches.sides` [4, J] in whole texels of a map of `height` rows: no texel is split."""
    shares = patches(device).sides.T
    size = shares.new_tensor([height, height, 2 * height, 2 * height])[:, None]
    return (shares * size).round().long()


@lru_cache(maxsize=16)
def _patch_of_texels(height: int, device: torch.device) -> torch.Tensor:
    """Which patch the texels [H · 2H] of a map are in, long."""
    found = torch.zeros(height, 2 * height, dtype=torch.long, device=device)
    for patch, (top, bottom, left, right) in enumerate(_sides(height, device).T.tolist()):
        found[top:bottom, left:right] = patch
    return found.flatten()


def bright_lobes(harmonics: torch.Tensor, radiance: torch.Tensor) -> torch.Tensor:
    """`Patches.lobes` [J, 9] weighted by the light in each patch: a sun is where it is.

    Args:
        harmonics: [9, H·W] harmonics × the clamped cosine's × the texels' solid angles. radiance: [H·W].
    """
    lobes = patches(radiance.device).lobes
    patch = _patch_of_texels(math.isqrt(len(radiance) // 2), radiance.device)
    sums = torch.zeros_like(lobes).index_add_(0, patch, (harmonics * radiance).T)
    power = sums[:, :1] / lobes[:, :1]
    return torch.where(power > 0, sums / power.clamp(min=1e-30), lobes)


def middles(lobes: torch.Tensor) -> torch.Tensor:
    """The mean directions [J, 3] of lobes [J, 9], unit, world: what their first band says."""
    return torch.nn.functional.normalize(lobes[:, [3, 1, 2]], dim=-1)


def power(table: torch.Tensor) -> torch.Tensor:
    """∫ L dω [J, 3] over every patch, of a light's prefix sums [H+1, W+1, 3] (`LightTables.table`)."""
    corners = _corners(len(table) - 1, table.device)
    # All corners at once: each gather's gradient would be a table of its own.
    first, second, third, fourth = table.flatten(0, 1).index_select(0, corners).chunk(4)
    return (first - second - third + fourth).float()


@lru_cache(maxsize=16)
def _corners(height: int, device: torch.device) -> torch.Tensor:
    """Where the patches' corners [4 J] are in a map's prefix sums: each patch's last one, the one left
    of it, the one above it, and its first."""
    top, bottom, left, right = _sides(height, device)
    ends = [(bottom, right), (bottom, left), (top, right), (top, left)]
    return torch.cat([row * (2 * height + 1) + column for row, column in ends])


def arriving_harmonics(table: torch.Tensor, arriving: Arriving) -> torch.Tensor:
    """Coefficients [R, 9, 3] of the irradiance at R points, linear in the light.

    Args:
        table: the light's prefix sums [H+1, W+1, 3].
    """
    lit = power(table)[:, None, :] * arriving.lobes[..., None]
    return (arriving.passing @ lit.flatten(1)).view(-1, *lit.shape[1:]) + arriving.sent


def irradiance(harmonics: torch.Tensor, normals: torch.Tensor) -> torch.Tensor:
    """Irradiance [N, 3] of surfaces with unit normals [N, 3], of its coefficients [9, 3], or [N, 9, 3]
    where every surface has its own."""
    basis = quadratic(normals) @ quadratic_form().to(normals)
    if harmonics.dim() == 2:
        return (basis @ harmonics).clamp(min=0)
    return torch.einsum("nl,nlc->nc", basis, harmonics).clamp(min=0)
