"""CPU kernels that `pointwise` runs by name.

Each is one call for what plain torch does in dozens, which take as long as what they compute and which
other cores cannot share.
"""

import numpy as np
from torch import Tensor

from . import loss_numba, shading_numba
from .backend import array_of


def has(name: str) -> bool:
    """True if there is a kernel of this name."""
    return hasattr(shading_numba, name) or hasattr(loss_numba, name)


def _kernel(name: str):
    return getattr(shading_numba, name, None) or getattr(loss_numba, name)


def run(name: str, inputs, numbers, outputs) -> None:
    """Run a kernel on all rows."""
    _kernel(name)(*map(_array, inputs), *numbers, *map(_array, outputs))


def run_adjoint(name: str, inputs, numbers, outputs, to_inputs, from_outputs) -> None:
    """Write to gradients `to_inputs` (or None) what comes of the cotangents of outputs.

    Raises:
        TypeError: one is wanted of an input that the adjoint has none of.
    """
    adjoint = _kernel(f"{name}_backward")
    given = (*map(_array, inputs), *numbers, *map(_array, outputs), *map(_array, from_outputs))
    written = adjoint.py_func.__code__.co_argcount - len(given)
    if any(gradient is not None for gradient in to_inputs[written:]):
        raise TypeError(f"{name}: gradients are for the first {written} inputs")
    for value, gradient in zip(inputs[:written], to_inputs, strict=False):
        given += (_array(value.new_empty(value.shape) if gradient is None else gradient),)
    adjoint(*given)


def _array(tensor: Tensor) -> np.ndarray:
    return array_of(tensor if tensor.is_contiguous() else tensor.contiguous())
