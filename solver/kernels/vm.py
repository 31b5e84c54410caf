"""Differentiable VM lookups: `vm_sum`, `vm_products`, `vm_gradient`, on the fastest path at hand.

Shapes and layout are those of `vm_torch`. Gradients flow to the factors only, never to positions.
"""

import torch
from torch import Tensor

from . import vm_torch
from .backend import fast, gradient_buffer, gradient_in_place, kernels, on_numba, on_warp
from .sending import constant_on

NEGLIGIBLE = 1e-3
"""cotangents below this share of their mean are left out of sums over many samples"""


class _Lookup(torch.autograd.Function):
    """`vm_products` or `vm_gradient`, of so many numbers a point."""

    @staticmethod
    def forward(ctx, points, planes, lines, name, numbers):
        ctx.save_for_backward(points, planes, lines)
        ctx.name = name
        out = planes.new_empty(len(points), numbers)
        getattr(kernels("vm", out.device), name)(points, planes, lines, out)
        return out

    @staticmethod
    def backward(ctx, cotangent):
        gradients = _to_factors(f"{ctx.name}_backward", ctx.saved_tensors, cotangent)
        return None, *gradients, None, None


class _Sum(torch.autograd.Function):
    @staticmethod
    def forward(ctx, points, planes, lines, known):
        ctx.save_for_backward(points, planes, lines)
        if known is not None:
            return known.clone()
        out = planes.new_empty(len(points))
        kernels("vm", out.device).vm_sum(points, planes, lines, out)
        return out

    @staticmethod
    def backward(ctx, cotangent):
        # Most samples of a ray lie before or behind its surface, with next to no gradient: together
        # those left out have less than a thousandth of it.
        least = NEGLIGIBLE * cotangent.abs().mean().nan_to_num()
        if not on_warp(least.device):
            least = float(least)  # where nothing waits for it
        gradients = _to_factors("vm_sum_backward", ctx.saved_tensors, cotangent, least)
        return None, *gradients, None


class _Smooth(torch.autograd.Function):
    """Smoothing is symmetric, so that it is its own adjoint."""

    @staticmethod
    def forward(ctx, factor, taps, kernel):
        ctx.save_for_backward(factor, taps)
        ctx.kernel = kernel
        return _smoothed(factor, taps, kernel)

    @staticmethod
    def backward(ctx, cotangent):
        factor, taps = ctx.saved_tensors
        cotangent = cotangent.contiguous()
        lying = gradient_in_place(factor) if on_numba(factor.device) else None
        if lying is None:
            return _smoothed(cotangent, taps, ctx.kernel), None, None
        getattr(kernels("vm", factor.device), f"add_{ctx.kernel}")(cotangent, taps, lying)
        return None, None, None


def _smoothed(factor: Tensor, taps: Tensor, kernel: str) -> Tensor:
    out = torch.empty_like(factor, memory_format=torch.contiguous_format)
    getattr(kernels("vm", factor.device), kernel)(factor, taps, out)
    return out


def _to_factors(adjoint: str, saved, cotangent: Tensor, *more):
    """Run an adjoint kernel; what autograd is to get for planes and lines."""
    points, planes, lines = saved
    (grad_planes, planes_out), (grad_lines, lines_out) = map(gradient_buffer, (planes, lines))
    run = getattr(kernels("vm", planes.device), adjoint)
    run(points, planes, lines, cotangent.contiguous(), *more, grad_planes, grad_lines)
    return planes_out, lines_out


def _contiguous(*tensors: Tensor) -> tuple[Tensor, ...]:
    return tuple(tensor.contiguous() for tensor in tensors)


def _looked_up(name: str, numbers: int, points: Tensor, planes: Tensor, lines: Tensor) -> Tensor:
    points = points.detach()
    if fast(planes):
        return _Lookup.apply(points.contiguous(), *_contiguous(planes, lines), name, numbers)
    return getattr(vm_torch, name)(points, planes, lines)


def vm_products(points: Tensor, planes: Tensor, lines: Tensor) -> Tensor:
    """All 3·C products at points [N, 3] in grid units → [N, 3·C]."""
    return _looked_up("vm_products", 3 * planes.shape[3], points, planes, lines)


def vm_sum(points: Tensor, planes: Tensor, lines: Tensor, known: Tensor | None = None) -> Tensor:
    """The sum of all products at points [N, 3] in grid units → [N].

    Args:
        known: the very sums [N], if they are known already; then only the gradient costs.
    """
    if fast(planes):
        return _Sum.apply(points.detach().contiguous(), *_contiguous(planes, lines), known)
    return vm_torch.vm_sum(points.detach(), planes, lines)


def vm_gradient(points: Tensor, planes: Tensor, lines: Tensor) -> Tensor:
    """Gradient per grid unit of the sum at points [N, 3] → [N, 3]; see `vm_torch`."""
    return _looked_up("vm_gradient", 3, points, planes, lines)


def smooth_planes(planes: Tensor, taps: Tensor) -> Tensor:
    """Odd, symmetric taps [2r + 1] along both axes of planes [3, G, G, C]; borders are mirrored."""
    if fast(planes):
        taps = constant_on(planes.device, tuple(taps.tolist()))
        return _Smooth.apply(planes.contiguous(), taps, "smooth_planes")
    return vm_torch.smooth_planes(planes, taps)


def smooth_lines(lines: Tensor, taps: Tensor) -> Tensor:
    """Odd, symmetric taps [2r + 1] along lines [3, G, C]; borders are mirrored."""
    if fast(lines):
        taps = constant_on(lines.device, tuple(taps.tolist()))
        return _Smooth.apply(lines.contiguous(), taps, "smooth_lines")
    return vm_torch.smooth(lines, taps, 1)
