"""One step of Adam on a tensor, that leaves alone what no ray has touched.

Kingma & Ba 2015 (https://arxiv.org/abs/1412.6980); lazy as torch's SparseAdam: rows (of the last axis)
whose gradient is all zero keep their value and their moments. Most of a grid is empty space.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
import torch

from .backend import fast, on_numba


class Moments(NamedTuple):
    """Running means of a tensor's gradient and of its square."""

    mean: torch.Tensor
    square: torch.Tensor


class Rates(NamedTuple):
    """What a step is scaled by."""

    step: float
    mean_decay: float
    square_decay: float
    epsilon: float
    count: int  # of steps, this one included


def adam_step(
    parameter: torch.Tensor, gradient: torch.Tensor, moments: Moments, rates: Rates
) -> None:
    """Change a contiguous parameter and its moments in place; set the gradient to zero."""
    if parameter.dim() == 0 or parameter.numel() == 0:
        raise ValueError("a parameter needs at least one axis and one entry")
    with torch.no_grad():
        step = rates.step / (1 - rates.mean_decay**rates.count)
        scale = 1 / (1 - rates.square_decay**rates.count)
        rows = parameter.shape[-1]
        tensors = [t.view(-1, rows) for t in (parameter, gradient, *moments)]
        factors = (step, scale, rates.mean_decay, rates.square_decay, rates.epsilon)
        if fast(parameter) and on_numba(parameter.device):
            _step(*(t.detach().numpy() for t in tensors), *map(np.float32, factors))
        else:
            adam_step_torch(*tensors, *factors)


def adam_step_torch(
    parameter: torch.Tensor, gradient: torch.Tensor, mean: torch.Tensor, square: torch.Tensor,
    step: float, scale: float, mean_decay: float, square_decay: float, epsilon: float,
) -> None:  # fmt: skip
    """Plain torch twin of the kernel, on tensors [N, C]."""
    touched = (gradient != 0).any(-1, keepdim=True)
    new_mean = mean_decay * mean + (1 - mean_decay) * gradient
    new_square = square_decay * square + (1 - square_decay) * gradient * gradient
    change = step * new_mean / ((scale * new_square).sqrt() + epsilon)
    mean.copy_(torch.where(touched, new_mean, mean))
    square.copy_(torch.where(touched, new_square, square))
    parameter.sub_(torch.where(touched, change, torch.zeros_like(change)))
    gradient.zero_()


@numba.njit(parallel=True, fastmath=True, cache=True, nogil=True)
def _step(parameter, gradient, mean, square, step, scale, mean_decay, square_decay, epsilon):
    one = np.float32(1)
    for n in numba.prange(parameter.shape[0]):
        largest = np.float32(0)
        for c in range(parameter.shape[1]):
            largest = max(largest, abs(gradient[n, c]))
        if largest == 0:
            continue
        for c in range(parameter.shape[1]):
            g = gradient[n, c]
            m = mean_decay * mean[n, c] + (one - mean_decay) * g
            s = square_decay * square[n, c] + (one - square_decay) * g * g
            mean[n, c] = m
            square[n, c] = s
            parameter[n, c] -= step * m / (np.sqrt(scale * s) + epsilon)
            gradient[n, c] = 0
