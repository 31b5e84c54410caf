"""Glossy reflection of a batch of samples in a few kernels, for devices that have a fast path.

`render.reflection` chooses between this and its plain torch twin, `scatter` and a lookup.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from .backend import gradient_buffer, kernels


class Blockers(NamedTuple):
    """What can be in a secondary ray's way: the occupancy grid over the field's box."""

    low: Tensor  # [3] world, the box's lower corner
    axes: Tensor  # [3, 3] rows, the box's axes in the world; [0, 3]: the world's own
    edge: float  # of the box, world units
    cell: float  # edge of a cell, world units
    blocking: Tensor  # bytes, see `skipping.blocking_grid`
    reach: float  # height above a surface from which rays can be blocked, world units


class Carried(NamedTuple):
    """What the rays [K] of the samples carried."""

    directions: Tensor  # [K, 3] world, unit
    weights: Tensor  # [K, 3] BRDF · cosine / density · share
    passing: Tensor  # [K] transmittance of the grid, no gradient


class Near(NamedTuple):
    """What of the light comes from close by (see `light.floor`)."""

    shifts: Tensor  # [S, 3] of the samples; [0, 3] if all light is far
    up: tuple[float, float, float]


class _Specular(torch.autograd.Function):
    @staticmethod
    def forward(ctx, normals, alphas, f0s, table, views, points, first, shares, together, u, rows,
                masking, averaged, widening, blockers, spread, near):  # fmt: skip
        samples, rays = len(normals), len(u)
        radiance = normals.new_empty(samples, 3)
        directions, weights, light = normals.new_empty(3, rays, 3).unbind()
        passing, slope = normals.new_empty(rays), normals.new_empty(rays, 3, 4)
        centre, size, growth = normals.new_empty(3, rays, 2).unbind()
        inputs = [v.contiguous() for v in (normals, views, alphas, f0s, first, shares, u)]
        kernels("specular", normals.device).specular(
            *inputs, masking, averaged, widening, spread.contiguous(), near.shifts.contiguous(), near.up,
            points.contiguous(), together.contiguous(), blockers.reach, blockers.low, blockers.axes,
            1 / blockers.edge, blockers.cell, blockers.blocking, table, rows, radiance, directions,
            weights, passing, light, slope, centre, size, growth,
        )  # fmt: skip
        ctx.masking, ctx.near = masking, near
        ctx.save_for_backward(
            *inputs, table, rows, directions, weights, passing, light, slope, centre, size, growth
        )
        ctx.mark_non_differentiable(passing)
        return radiance, directions, weights, passing

    @staticmethod
    def backward(ctx, cotangent, g_directions, g_weights, _):
        *inputs, table, rows, directions, weights, passing, light, slope, centre, size, growth = (
            ctx.saved_tensors
        )
        normals, near = inputs[0], ctx.near
        height, width = table.shape[0] - 1, table.shape[1] - 1
        g_normals, g_f0s = torch.empty_like(normals), torch.empty_like(normals)
        g_alphas, to_light = normals.new_empty(len(normals)), torch.empty_like(light)
        kernels("specular", table.device).specular_backward(
            *inputs, ctx.masking, near.shifts.contiguous(), near.up, directions, weights, passing,
            light, slope, growth, width, height, cotangent.contiguous(), g_directions.contiguous(),
            g_weights.contiguous(), g_normals, g_alphas, g_f0s, to_light,
        )  # fmt: skip
        buffer, g_table = gradient_buffer(table)
        kernels("integral", table.device).rectangle_mean_backward(rows, centre, size, to_light, buffer)
        return g_normals, g_alphas, g_f0s, g_table, *[None] * 13


def specular(
    normals: Tensor, alphas: Tensor, f0s: Tensor, table: Tensor,
    views: Tensor, points: Tensor, first: Tensor, shares: Tensor,
    together: Tensor, u: Tensor, rows: Tensor, masking: bool, averaged: bool,
    widening: bool, blockers: Blockers, spread: Tensor | None = None, near: Near | None = None,
) -> tuple[Tensor, Carried]:  # fmt: skip
    """Radiance [S, 3] that samples reflect from the environment, as far as the grid lets it through.

    Args:
        normals, views: [S, 3] world, unit, normals on the viewer's side. alphas: [S]. f0s: [S, 3].
        table, rows: of the light (`integral.rectangle_mean`). points: [S, 3] world.
        first: [S + 1] where each sample's rays begin. shares: [S] by how much each of them counts.
        together: [S] how many rays share the lobe of each (`drawing.Plan`). u: [K, 2] uniform in [0, 1).
        masking: weigh by G2/G1. averaged: a ray stands for its share of the solid angle. widening:
            gradients to alphas know of that.
        spread: [S, 2, 3] what the pixel adds to that (`footprint.reflected_spread`); none: nothing.
        near: what of the light comes from close by; none: nothing.

    Gradients of the radiance flow to normals, alphas, f0s and the table, those of what rays carried to
    the first three.

    Raises:
        ValueError: `first` is of other samples; kernels would read beyond their arrays.
    """
    if len(first) != len(normals) + 1:
        raise ValueError(f"first: {len(normals) + 1} numbers wanted, {len(first)} given")
    spread = normals.new_zeros(len(normals), 2, 3) if spread is None else spread
    near = Near(normals.new_empty(0, 3), (0.0, 0.0, 0.0)) if near is None else near
    radiance, *carried = _Specular.apply(
        normals, alphas, f0s, table, views, points, first, shares, together, u, rows, masking,
        averaged, widening, blockers, spread, near,
    )  # fmt: skip
    return radiance, Carried(*carried)
