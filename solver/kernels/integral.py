"""Means of an environment map over rectangles, by summed-area table, on the fastest path at hand."""

from __future__ import annotations

import torch

from . import integral_numba, integral_torch
from .backend import fast


class _RectangleMean(torch.autograd.Function):
    @staticmethod
    def forward(ctx, table, rows, centre, size):
        out = torch.empty(len(centre), 3)
        slope = torch.empty(len(centre), 3, 2)
        integral_numba.rectangle_mean(
            table.numpy(), rows.numpy(), centre.numpy(), size.numpy(), out.numpy(), slope.numpy()
        )
        ctx.save_for_backward(rows, centre, size, slope)
        ctx.shape = table.shape
        return out

    @staticmethod
    def backward(ctx, cotangent):
        rows, centre, size, slope = ctx.saved_tensors
        grad_table = grad_centre = None
        if ctx.needs_input_grad[0]:
            grad_table = torch.zeros(ctx.shape, dtype=torch.float64)
            integral_numba.rectangle_mean_backward(
                rows.numpy(), centre.numpy(), size.numpy(), cotangent.contiguous().numpy(),
                grad_table.numpy(),
            )  # fmt: skip
        if ctx.needs_input_grad[2]:
            grad_centre = torch.einsum("nc,ncd->nd", cotangent, slope)
        return grad_table, None, grad_centre, None


def rectangle_mean(
    table: torch.Tensor, rows: torch.Tensor, centre: torch.Tensor, size: torch.Tensor
) -> torch.Tensor:
    """Solid-angle weighted mean over rectangles on the sphere (paper Appendix A) → [N, 3] float.

    Args:
        table: [3, H+1, W+1] double, exclusive prefix sums of radiance × solid angle.
        rows: [H+1] double, prefix sums of a texel's solid angle down the rows.
        centre, size: [N, 2] (column, row) in texels; size at most (W, H). Rectangles wrap around
            the seam and over the poles. Gradients flow to the table and the centre, not the size.
    """
    if fast(centre):
        return _RectangleMean.apply(
            table.contiguous(), rows, centre.contiguous(), size.detach().contiguous()
        )
    return integral_torch.rectangle_mean(table, rows, centre, size.detach()).to(centre.dtype)
