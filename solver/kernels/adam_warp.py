"""Adam's step in Warp, for CUDA; `adam.adam_step_torch` is the plain twin."""

import torch
import warp as wp

from .sending import constant_on
from .vectors_warp import Numbers, Vectors
from .warp_device import launch

wp.set_module_options({"enable_backward": False})


LONG_ROW = 64
"""numbers of a row from which on it is shared out"""


@wp.func
def move(
    parameter: Vectors, gradient: Vectors, mean: Vectors, square: Vectors, size: float, scale: float,
    mean_decay: float, square_decay: float, epsilon: float, n: int, c: int,
):  # fmt: skip
    g = gradient[n, c]
    m = mean_decay * mean[n, c] + (1.0 - mean_decay) * g
    s = square_decay * square[n, c] + (1.0 - square_decay) * g * g
    mean[n, c] = m
    square[n, c] = s
    parameter[n, c] = parameter[n, c] - size * m / (wp.sqrt(scale * s) + epsilon)
    gradient[n, c] = 0.0


@wp.kernel
def _step_rows(
    parameter: Vectors, gradient: Vectors, mean: Vectors, square: Vectors, size: float, scale: float,
    mean_decay: float, square_decay: float, epsilon: Numbers,
):  # fmt: skip
    n = wp.tid()
    touched = bool(False)
    for c in range(gradient.shape[1]):
        touched = touched or gradient[n, c] != 0.0
    if touched:
        for c in range(gradient.shape[1]):
            move(parameter, gradient, mean, square, size, scale, mean_decay, square_decay, epsilon[0], n, c)


@wp.kernel
def _touch(gradient: Vectors, touched: wp.array(dtype=wp.uint8)):
    n, c = wp.tid()
    if gradient[n, c] != 0.0:
        touched[n] = wp.uint8(1)


@wp.kernel
def _step(
    parameter: Vectors, gradient: Vectors, mean: Vectors, square: Vectors, size: float, scale: float,
    mean_decay: float, square_decay: float, epsilon: Numbers, touched: wp.array(dtype=wp.uint8),
):  # fmt: skip
    n, c = wp.tid()
    if touched[n] != wp.uint8(0):
        move(parameter, gradient, mean, square, size, scale, mean_decay, square_decay, epsilon[0], n, c)


def step(parameter, gradient, mean, square, size, scale, mean_decay, square_decay, epsilon) -> None:
    """Change all tensors [N, C] in place; see the twin."""
    if not isinstance(epsilon, torch.Tensor):
        epsilon = constant_on(parameter.device, (epsilon,))
    rows, columns = parameter.shape
    arguments = parameter, gradient, mean, square, size, scale, mean_decay, square_decay, epsilon
    if columns < LONG_ROW:
        launch(_step_rows, rows, *arguments)
        return
    touched = torch.zeros(rows, dtype=torch.uint8, device=parameter.device)
    launch(_touch, (rows, columns), gradient, touched)
    launch(_step, (rows, columns), *arguments, touched)
