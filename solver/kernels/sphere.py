"""Bilinear lookups of a map on the sphere, all of a new map at once, on the fastest path at hand."""

import torch

from . import sphere_torch
from .backend import fast_on_numba, kernels


class _LookUp(torch.autograd.Function):
    @staticmethod
    def forward(ctx, values, places):
        out = values.new_empty(len(values), *places.shape[:2])
        kernels("sphere", values.device).look_up(values, places, out)
        ctx.save_for_backward(places)
        ctx.shape = values.shape
        return out

    @staticmethod
    def backward(ctx, cotangent):
        (places,) = ctx.saved_tensors
        grad = cotangent.new_zeros(ctx.shape)
        run = kernels("sphere", cotangent.device)
        run.look_up_backward(places, cotangent.contiguous(), grad)
        return grad, None


def look_up(values: torch.Tensor, places: torch.Tensor) -> torch.Tensor:
    """A map [3, H, W] at continuous (column, row) [H', W', 2] on it, bilinear on the sphere: [3, H', W'].

    Columns go on around, and rows beyond a pole half a turn away. Places have no gradient.

    Raises:
        ValueError: the map has not three channels, beyond which a kernel would write.
    """
    if len(values) != 3:
        raise ValueError(f"a map has three channels, this one has {len(values)}")
    if fast_on_numba(values) and not places.requires_grad:
        return _LookUp.apply(values.contiguous(), places.contiguous())
    return sphere_torch.look_up(values, places)
