"""One step of Adam on a tensor, that leaves alone what no ray has touched.

Kingma & Ba 2015 (https://arxiv.org/abs/1412.6980); lazy as torch's SparseAdam: rows (of the last axis)
whose gradient is all zero keep their value and their moments. Most of a grid is empty space.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from .backend import fast, fast_on_numba, kernels, on_warp


class Moments(NamedTuple):
    """Running means of a tensor's gradient and of its square."""

    mean: Tensor
    square: Tensor


class Rates(NamedTuple):
    """What a step is scaled by."""

    step: float
    mean_decay: float
    square_decay: float
    epsilon: float | Tensor  # a number, or one in memory [1]
    count: int  # of steps, this one included


def adam_step(parameter: Tensor, gradient: Tensor, moments: Moments, rates: Rates) -> None:
    """Change a contiguous parameter and its moments in place; set the gradient to zero."""
    if parameter.dim() == 0 or parameter.numel() == 0:
        raise ValueError("a parameter needs at least one axis and one entry")
    with torch.no_grad():
        size = rates.step / (1 - rates.mean_decay**rates.count)
        scale = 1 / (1 - rates.square_decay**rates.count)
        rows = parameter.shape[-1]
        tensors = [t.view(-1, rows) for t in (parameter, gradient, *moments)]
        epsilon = rates.epsilon if on_warp(parameter.device) else float(rates.epsilon)
        factors = (size, scale, rates.mean_decay, rates.square_decay, epsilon)
        if fast(parameter):
            kernels("adam", parameter.device).step(*tensors, *factors)
        else:
            adam_step_torch(*tensors, *factors)


def adam_step_torch(
    parameter: Tensor, gradient: Tensor, mean: Tensor, square: Tensor,
    size: float, scale: float, mean_decay: float, square_decay: float, epsilon: float,
) -> None:  # fmt: skip
    """Plain torch twin of the kernels, on tensors [N, C]; `size` and `scale` undo what means start from."""
    touched = (gradient != 0).any(-1, keepdim=True)
    new_mean = mean_decay * mean + (1 - mean_decay) * gradient
    new_square = square_decay * square + (1 - square_decay) * gradient * gradient
    change = size * new_mean / ((scale * new_square).sqrt() + epsilon)
    mean.copy_(torch.where(touched, new_mean, mean))
    square.copy_(torch.where(touched, new_square, square))
    parameter.sub_(torch.where(touched, change, torch.zeros_like(change)))
    gradient.zero_()


def mean_root_square(gradient: Tensor, moments: Moments, square_decay: float, count: int) -> float | Tensor:
    """Mean of the roots of the running square that a contiguous tensor will have after the step with this
    gradient, what it started from undone; in memory where nothing is to wait for it."""
    scale = 1 / (1 - square_decay**count)
    if fast_on_numba(gradient):
        rows = gradient.shape[-1]
        tensors = moments.square.view(-1, rows), gradient.view(-1, rows)
        return kernels("adam", gradient.device).mean_root(*tensors, square_decay, scale)
    square = square_decay * moments.square + (1 - square_decay) * gradient * gradient
    return (scale * square).sqrt().mean()
