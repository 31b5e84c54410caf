"""What rays see of a few samples drawn by weight, in one kernel, for the CPU.

`render.depths` chooses between this and its plain torch twin.
"""

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from .backend import kernels


class _Seen(torch.autograd.Function):
    @staticmethod
    def forward(ctx, values, weights, opacity, index, ray, share, least, others):
        values, mean = values.contiguous(), values.new_empty(len(opacity), values.shape[1])
        out = torch.empty_like(mean)
        chosen = values, ray, share, opacity.contiguous(), mean
        kernels("seen", values.device).seen(*chosen, out)
        ctx.save_for_backward(*chosen, weights, index)
        ctx.numbers = least, others
        return out

    @staticmethod
    @once_differentiable
    def backward(ctx, cotangent):
        values, ray, share, opacity, mean, weights, index = ctx.saved_tensors
        gradients = torch.empty_like(values), torch.empty_like(opacity), torch.zeros_like(weights)
        kernels("seen", values.device).seen_backward(
            values, ray, share, opacity, mean, weights, index, *ctx.numbers, cotangent.contiguous(),
            *gradients,
        )  # fmt: skip
        to_values, to_opacity, to_weights = gradients
        return to_values, to_weights, to_opacity, *[None] * 5


def seen(
    values: Tensor, weights: Tensor, opacity: Tensor, index: Tensor,
    ray: Tensor, share: Tensor, least: float, others: float,
) -> Tensor:  # fmt: skip
    """What rays see [R, C] of what samples show [K, C].

    Args:
        weights: [S] contiguous, of all samples; the chosen ones are at `index` [K] long.
        opacity: [R]. ray: [K] long. share: [K] of the ray's opacity; sums to one over a ray.
        least: weight of samples whose gradient counts. others: how much their share's gradient counts.

    Gradients flow to values, weights and opacity.
    """
    return _Seen.apply(values, weights, opacity, index, ray, share, least, others)
