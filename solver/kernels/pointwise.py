"""Shading of samples and priors of pixels in one kernel each, on the CPU and on cards that Warp runs on.

Where each is called stands its plain torch twin: in `field.field`, `field.heads`, `brdf.neural`,
`render.shade`, `render.reflection`, `render.footprint`, `render.smoothness`, `fit.losses` and `fit.priors`.
"""

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from .backend import fast, kernels, on_warp

Shape = tuple[int, ...]


def at_hand(name: str, tensor: Tensor) -> bool:
    """True where `rowwise` has a kernel of this name for a tensor's device and type."""
    return fast(tensor) and kernels("pointwise", tensor.device).has(name)


class _Rowwise(torch.autograd.Function):
    @staticmethod
    def forward(ctx, name, rows, widths, numbers, *inputs):
        outputs = [inputs[0].new_empty(rows, *width) for width in widths]
        kernels("pointwise", inputs[0].device).run(name, inputs, numbers, outputs)
        ctx.name, ctx.numbers, ctx.count = name, numbers, len(inputs)
        ctx.save_for_backward(*inputs, *outputs)
        return tuple(outputs)

    @staticmethod
    @once_differentiable
    def backward(ctx, *cotangents):
        inputs, outputs = ctx.saved_tensors[: ctx.count], ctx.saved_tensors[ctx.count :]
        begun = _zeros if on_warp(inputs[0].device) else _unwritten
        gradients = begun(inputs, ctx.needs_input_grad[4:])
        kernels("pointwise", inputs[0].device).run_adjoint(
            ctx.name, inputs, ctx.numbers, outputs, gradients, [c.contiguous() for c in cotangents]
        )
        return None, None, None, None, *gradients


def _unwritten(inputs: Sequence[Tensor], needed: Sequence[bool]) -> list[Tensor | None]:
    """Gradients of the inputs that need one, for adjoints that write all of them."""
    return [
        value.new_empty(value.shape) if wanted else None
        for value, wanted in zip(inputs, needed, strict=True)
    ]


def _zeros(inputs: Sequence[Tensor], needed: Sequence[bool]) -> list[Tensor | None]:
    """Gradients to begin with of the inputs that need one: parts of one tensor, which is filled at once."""
    sizes = [value.numel() if wanted else 0 for value, wanted in zip(inputs, needed, strict=True)]
    parts = inputs[0].new_zeros(sum(sizes)).split(sizes)
    return [
        part.view(value.shape) if wanted else None
        for part, value, wanted in zip(parts, inputs, needed, strict=True)
    ]


def rowwise(
    name: str, inputs: tuple[Tensor, ...], numbers: tuple[float, ...], widths: tuple[Shape, ...],
    rows: int | None = None,
) -> tuple[Tensor, ...]:  # fmt: skip
    """What a kernel of this name makes of inputs [N, ...] and numbers: [N, *width] each.

    Gradients flow to the inputs, of which those that never have one come last; on the CPU a gradient that
    one of them needs is a `TypeError`.

    Args:
        rows: N, if it is not that of the first input.
    """
    rows = len(inputs[0]) if rows is None else rows
    return _Rowwise.apply(name, rows, widths, numbers, *inputs)
