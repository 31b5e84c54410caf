"""Diffuse light between probes in one kernel, for devices that have a fast path.

`render.probes` chooses between this and its plain torch twin.
"""

import torch
from torch import Tensor

from .backend import gradient_buffer, kernels


class _Between(torch.autograd.Function):
    @staticmethod
    def forward(ctx, table, normals, points, row, clear, spacing, form):
        samples, normals = len(points), normals.contiguous()
        out, rows = normals.new_empty(samples, 3), row.new_empty(samples, 8)
        shares, blended = normals.new_empty(samples, 8), normals.new_empty(samples, 27)
        kernels("probe_light", normals.device).irradiance_between(
            points.contiguous(), row, clear, 1 / spacing, table.flatten(1), normals, form, out, rows,
            shares, blended,
        )  # fmt: skip
        ctx.save_for_backward(table, normals, form, out, rows, shares, blended)
        return out

    @staticmethod
    def backward(ctx, cotangent):
        table, *saved = ctx.saved_tensors
        buffer, g_table = gradient_buffer(table)
        g_normals = torch.empty_like(saved[0])
        kernels("probe_light", table.device).irradiance_between_backward(
            *saved, cotangent.contiguous(), buffer.flatten(1), g_normals
        )
        return g_table, g_normals, *[None] * 5


def irradiance_between(
    table: Tensor, normals: Tensor, points: Tensor, row: Tensor, clear: Tensor, spacing: float, form: Tensor
) -> Tensor:
    """Irradiance [S, 3] of surfaces with unit normals [S, 3], of the coefficients of the nodes around
    points [S, 3].

    Args:
        table: [1 + R, 9, 3] contiguous: coefficients. points: [S, 3] in units of which `spacing` is the
            nodes'. row: [N, N, N] long, of the table. clear: [N, N, N] how much each counts.
        form: [16, 9] of the harmonics (`light.spherical_harmonics.quadratic_form`).

    Gradients flow to table and normals.
    """
    return _Between.apply(table, normals, points.detach(), row, clear, spacing, form)
