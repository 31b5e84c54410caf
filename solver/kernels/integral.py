"""Means of an environment map over rectangles, by summed-area table, on the fastest path at hand."""

import torch
import torch.nn.functional as F
from torch import Tensor
from torch.autograd.function import once_differentiable

from . import integral_torch
from .backend import fast, fast_on_numba, gradient_buffer, kernels, on_numba


class _RectangleMean(torch.autograd.Function):
    @staticmethod
    def forward(ctx, table, rows, centre, size):
        out, slope = centre.new_empty(len(centre), 3), centre.new_empty(len(centre), 3, 4)
        run = kernels("integral", centre.device)
        run.rectangle_mean(table, rows, centre, size, out, slope)
        ctx.save_for_backward(table, rows, centre, size, slope)
        return out

    @staticmethod
    def backward(ctx, cotangent):
        table, rows, centre, size, slope = ctx.saved_tensors
        grad_table = grad_centre = grad_size = None
        if ctx.needs_input_grad[0]:
            buffer, grad_table = gradient_buffer(table)
            run = kernels("integral", centre.device)
            run.rectangle_mean_backward(rows, centre, size, cotangent.contiguous(), buffer)
        if ctx.needs_input_grad[2]:
            grad_centre = torch.einsum("nc,ncd->nd", cotangent, slope[..., :2])
        if ctx.needs_input_grad[3]:
            grad_size = torch.einsum("nc,ncd->nd", cotangent, slope[..., 2:])
        return grad_table, None, grad_centre, grad_size


class _PrefixSums(torch.autograd.Function):
    @staticmethod
    def forward(ctx, values, row_weights):
        channels, height, width = values.shape
        table = torch.empty(height + 1, width + 1, channels, dtype=torch.float64)
        kernels("integral", values.device).prefix_sums(values, row_weights, table)
        ctx.save_for_backward(row_weights)
        return table

    @staticmethod
    def backward(ctx, cotangent):
        (row_weights,) = ctx.saved_tensors
        height, width, channels = cotangent.shape
        out = torch.empty(channels, height - 1, width - 1)
        run = kernels("integral", cotangent.device)
        run.prefix_sums_backward(cotangent.contiguous(), row_weights, out)
        return out, None


class _CornerSums(torch.autograd.Function):
    @staticmethod
    def forward(ctx, rows, at, share):
        out = rows.new_empty(len(at), rows.shape[1])
        kernels("integral", rows.device).corner_sums(rows, at, share, out)
        ctx.save_for_backward(rows, at, share)
        return out

    @staticmethod
    @once_differentiable
    def backward(ctx, cotangent):
        rows, at, share = ctx.saved_tensors
        gradient = torch.zeros_like(rows)
        kernels("integral", gradient.device).corner_sums_backward(
            at, share, cotangent.contiguous(), gradient
        )
        return gradient, None, None


def corner_sums(rows: Tensor, at: Tensor, share: Tensor) -> Tensor:
    """Sums [J, C] of rows [N, C] double at places [J, K] long, each by its share [J, K] double."""
    if on_numba(rows.device) and rows.dtype == torch.float64:
        return _CornerSums.apply(rows.contiguous(), at, share)
    return F.embedding_bag(at, rows, per_sample_weights=share, mode="sum")


def prefix_sums(values: Tensor, row_weights: Tensor) -> Tensor:
    """Summed-area table [H+1, W+1, 3] of values [3, H, W] times row weights [H], for `rectangle_mean`.

    In the precision of the row weights: with a sun in the map, differences of float sums turn
    negative far from the sun.
    """
    if fast_on_numba(values):  # torch scans well on a graphics card
        return _PrefixSums.apply(values.contiguous(), row_weights)
    return integral_torch.prefix_sums(values, row_weights)


def rectangle_mean(table: Tensor, rows: Tensor, centre: Tensor, size: Tensor) -> Tensor:
    """Solid-angle weighted mean over rectangles on the sphere (paper Appendix A) → [N, 3] float.

    Args:
        table: [H+1, W+1, 3] double, exclusive prefix sums of radiance × solid angle.
        rows: [H+1] double, prefix sums of a texel's solid angle down the rows.
        centre, size: [N, 2] (column, row) in texels; size at most (W, H). Rectangles wrap around
            the seam and over the poles. Gradients flow to all but the rows.
    """
    if fast(centre):
        return _RectangleMean.apply(table.contiguous(), rows, centre.contiguous(), size.contiguous())
    return integral_torch.rectangle_mean(table, rows, centre, size).to(centre.dtype)
