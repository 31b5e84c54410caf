"""Kernels in Warp, for CUDA, that `pointwise` runs by name.

Each is one launch for what plain torch does in dozens: on a card, whose numbers take no time, launches are
what a step waits for.
"""

from . import loss_warp, shading_warp
from .warp_device import launch, launch_adjoint


def has(name: str) -> bool:
    """True if there is a kernel of this name."""
    return hasattr(shading_warp, name) or hasattr(loss_warp, name)


def _kernel(name: str):
    return getattr(shading_warp, name, None) or getattr(loss_warp, name)


def run(name: str, inputs, numbers, outputs) -> None:
    """Run a kernel on all rows."""
    launch(_kernel(name), len(outputs[0]), *inputs, *numbers, *outputs)


def run_adjoint(name: str, inputs, numbers, outputs, to_inputs, from_outputs) -> None:
    """Add to gradients `to_inputs` (or None) what comes of the cotangents of outputs."""
    none = [None] * len(numbers)
    launch_adjoint(
        _kernel(name), len(outputs[0]), (*inputs, *numbers, *outputs), (*to_inputs, *none, *from_outputs)
    )
