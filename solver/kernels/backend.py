"""Which of two equal paths a computation takes: the fused CPU kernel or the plain torch twin."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import torch

_state = {"fused": True, "in_place": False}


def fast(tensor: torch.Tensor) -> bool:
    """True where the fused kernels apply: 32-bit tensors on the CPU, unless `plain_torch` is active."""
    return fast_device(tensor.device) and tensor.dtype == torch.float32


def fast_device(device: torch.device) -> bool:
    """True on devices that the fused kernels know, unless `plain_torch` is active."""
    return _state["fused"] and device.type == "cpu"


def precise(device: torch.device) -> torch.dtype:
    """The type for long sums: double where the device has it."""
    return torch.float32 if device.type == "mps" else torch.float64


@contextlib.contextmanager
def plain_torch() -> Iterator[None]:
    """Within this block every computation takes the plain torch twin (tests and benchmarks)."""
    before = _state["fused"]
    _state["fused"] = False
    try:
        yield
    finally:
        _state["fused"] = before


@contextlib.contextmanager
def gradients_in_place() -> Iterator[None]:
    """Within this block kernels add gradients of leaves to their `.grad` where it lies.

    For `backward()` only: `torch.autograd.grad` would miss them. It saves a new tensor as large as a
    grid, and an addition to the old one, for every lookup.
    """
    before = _state["in_place"]
    _state["in_place"] = True
    try:
        yield
    finally:
        _state["in_place"] = before


def gradient_buffer(tensor: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor | None]:
    """Where a backward pass may add the gradient of an input, and what it then has to return."""
    if _state["in_place"] and tensor.is_leaf:
        if tensor.grad is None:
            tensor.grad = torch.zeros_like(tensor)
        return tensor.grad, None
    buffer = torch.zeros_like(tensor)
    return buffer, buffer
