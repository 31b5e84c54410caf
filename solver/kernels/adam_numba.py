"""Adam's step on the CPU; `adam.adam_step_torch` is the plain twin."""

import numba
import numpy as np

from .compiling import kernel, serial_kernel


@kernel
def step(parameter, gradient, mean, square, size, scale, mean_decay, square_decay, epsilon):
    """Change all tensors [N, C] in place; see the twin."""
    one = np.float32(1)
    size, scale, epsilon = np.float32(size), np.float32(scale), np.float32(epsilon)
    mean_decay, square_decay = np.float32(mean_decay), np.float32(square_decay)
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
            parameter[n, c] -= size * m / (np.sqrt(scale * s) + epsilon)
            gradient[n, c] = 0


@serial_kernel
def mean_root(square, gradient, decay, scale):
    """Mean of the roots of the running square that tensors [N, C] are about to have."""
    decay, scale, rest = np.float32(decay), np.float32(scale), np.float32(1 - decay)
    total = 0.0
    for n in range(square.shape[0]):
        part = np.float32(0)
        for c in range(square.shape[1]):
            g = gradient[n, c]
            part += np.sqrt(scale * (decay * square[n, c] + rest * g * g))
        total += part
    return total / square.size
