"""Glossy reflection of a batch of samples in two kernels, for devices that have a fast path.

`render.reflection` chooses between this and its plain torch twin, `scatter` and a lookup.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch

from . import integral_numba, specular_numba
from .backend import gradient_buffer
from .specular_numba import SELF_SHADOW_COSINE

__all__ = ["SELF_SHADOW_COSINE", "Blockers", "Carried", "Near", "specular"]


class Blockers(NamedTuple):
    """What can be in a secondary ray's way: the occupancy grid over the field's box."""

    low: torch.Tensor  # [3] world, the box's lower corner
    edge: float  # of the box, world units
    cell: float  # edge of a cell, world units
    blocking: torch.Tensor  # [K, K, K] bytes, see `skipping`
    reach: float  # height above a surface from which rays can be blocked, world units


class Carried(NamedTuple):
    """What the rays [K] of the samples carried."""

    directions: torch.Tensor  # [K, 3] world, unit
    weights: torch.Tensor  # [K, 3] BRDF · cosine / density · share
    passing: torch.Tensor  # [K] transmittance of the grid, no gradient


class Near(NamedTuple):
    """What of the light comes from close by (see `light.floor`)."""

    shifts: torch.Tensor  # [S, 3] of the samples; none at all if all light is far
    up: tuple[float, float, float]


ALL_FAR = Near(torch.empty(0, 3), (0.0, 0.0, 0.0))


class _Specular(torch.autograd.Function):
    @staticmethod
    def forward(ctx, normals, alphas, f0s, table, views, points, first, shares, u, rows, masking,
                averaged, blockers, spread, near):  # fmt: skip
        samples, rays = len(normals), len(u)
        radiance = torch.empty(samples, 3)
        directions, weights, light = torch.empty(3, rays, 3).unbind()
        passing, slope = torch.empty(rays), torch.empty(rays, 3, 2)
        centre, size = torch.empty(2, rays, 2).unbind()
        inputs = [normals, views, alphas, f0s, first, shares, u]
        arrays = [value.detach().contiguous().numpy() for value in inputs]
        specular_numba.specular(
            *arrays, masking, averaged, spread.contiguous().numpy(), *_arrays_of(near),
            points.contiguous().numpy(), blockers.reach,
            blockers.low.double().numpy(), 1 / blockers.edge, blockers.cell,
            blockers.blocking.numpy(), table.numpy(), rows.numpy(), radiance.numpy(),
            directions.numpy(), weights.numpy(), passing.numpy(), light.numpy(), slope.numpy(),
            centre.numpy(), size.numpy(),
        )  # fmt: skip
        ctx.masking, ctx.near = masking, near
        ctx.save_for_backward(
            *inputs, table, rows, directions, weights, passing, light, slope, centre, size
        )
        ctx.mark_non_differentiable(passing)
        return radiance, directions, weights, passing

    @staticmethod
    def backward(ctx, cotangent, g_directions, g_weights, _):
        *inputs, table, rows, directions, weights, passing, light, slope, centre, size = (
            ctx.saved_tensors
        )
        arrays = [value.detach().contiguous().numpy() for value in inputs]
        normals, first, cotangent = inputs[0], arrays[4], cotangent.contiguous().numpy()
        height, width = table.shape[0] - 1, table.shape[1] - 1
        g_normals, g_f0s = torch.empty_like(normals), torch.empty_like(normals)
        g_alphas = torch.empty(len(normals))
        specular_numba.specular_backward(
            *arrays, ctx.masking, *_arrays_of(ctx.near), directions.numpy(), light.numpy(),
            slope.numpy(), width, height, cotangent, g_directions.contiguous().numpy(),
            g_weights.contiguous().numpy(),
            g_normals.numpy(), g_alphas.numpy(), g_f0s.numpy(),
        )  # fmt: skip
        to_light = torch.empty_like(light)
        specular_numba.light_cotangents(
            first, cotangent, weights.numpy(), passing.numpy(), to_light.numpy()
        )
        buffer, g_table = gradient_buffer(table)
        integral_numba.rectangle_mean_backward(
            rows.numpy(), centre.numpy(), size.numpy(), to_light.numpy(), buffer.detach().numpy()
        )
        return g_normals, g_alphas, g_f0s, g_table, *[None] * 11


def _arrays_of(near: Near) -> tuple[np.ndarray, np.ndarray]:
    return near.shifts.contiguous().numpy(), np.array(near.up)


def specular(
    normals: torch.Tensor, alphas: torch.Tensor, f0s: torch.Tensor, table: torch.Tensor,
    views: torch.Tensor, points: torch.Tensor, counts: torch.Tensor, shares: torch.Tensor,
    u: torch.Tensor, rows: torch.Tensor, masking: bool, averaged: bool, blockers: Blockers,
    spread: torch.Tensor | None = None, near: Near = ALL_FAR,
) -> tuple[torch.Tensor, Carried]:  # fmt: skip
    """Radiance [S, 3] that samples reflect from the environment, as far as the grid lets it through.

    Args:
        normals, views: [S, 3] world, unit, normals on the viewer's side. alphas: [S]. f0s: [S, 3].
        table, rows: of the light (`integral.rectangle_mean`). points: [S, 3] world.
        counts: [S] rays of each sample. shares: [S] by how much each of them counts.
        u: [K, 2] uniform in [0, 1), K = Σ counts.
        masking: weigh by G2/G1. averaged: a ray stands for its share of the solid angle.
        spread: [S, 2, 3] what the pixel adds to that (`footprint.reflected_spread`); none: nothing.
        near: what of the light comes from close by.

    Gradients of the radiance flow to normals, alphas, f0s and the table, those of what rays carried to
    the first three.
    """
    first = torch.nn.functional.pad(counts.cumsum(0), (1, 0))
    spread = normals.new_zeros(len(normals), 2, 3) if spread is None else spread
    radiance, *carried = _Specular.apply(
        normals, alphas, f0s, table, views, points, first, shares, u, rows, masking, averaged,
        blockers, spread, near,
    )  # fmt: skip
    return radiance, Carried(*carried)
