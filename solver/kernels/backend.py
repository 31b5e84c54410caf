"""Which of several equal paths a computation takes: numba on the CPU, Warp on CUDA, or plain torch.

A family of kernels, "vm" for instance, is the modules `vm_numba` and `vm_warp`, with the same functions.
The twin that both are tested against is `vm_torch`, or stands where they are called. Some have one path.
"""

import contextlib
import importlib
import importlib.util
from collections.abc import Callable, Iterator
from functools import cache

import numpy as np
import torch
from torch import Tensor

_state = {"path": "auto", "in_place": False}


def path_of(device: torch.device) -> str:
    """'numba', 'warp' or 'torch': the fastest path at hand for a device, unless one is forced."""
    if _state["path"] != "auto":
        return _state["path"]
    if device.type == "cpu":
        return "numba"
    return "torch" if device.type != "cuda" or trouble_with_warp(str(device)) else "warp"


@cache
def trouble_with_warp(device: str) -> str:
    """Why its kernels do not run on a card, so that jobs take torch's path, and what helps where that is
    known; empty if they do."""
    if importlib.util.find_spec("warp") is None:
        return "warp-lang is not installed"
    from .warp_device import trouble_on
    from .warp_folder import first_aid

    trouble = trouble_on(torch.device(device))
    return "; ".join(filter(None, (trouble, first_aid()))) if trouble else ""


def has_kernels(device: torch.device) -> bool:
    """True for a device that has a faster path than plain torch."""
    return path_of(device) != "torch"


def fast(tensor: Tensor) -> bool:
    """True where kernels apply: 32-bit tensors on a device that has a path for them."""
    return tensor.dtype == torch.float32 and has_kernels(tensor.device)


def on_numba(device: torch.device) -> bool:
    """True where kernels that exist for the CPU only apply."""
    return path_of(device) == "numba"


def fast_on_numba(tensor: Tensor) -> bool:
    """True where kernels that exist for the CPU only apply, and are for 32-bit tensors."""
    return fast(tensor) and on_numba(tensor.device)


def on_warp(device: torch.device) -> bool:
    """True where kernels that exist for cards only apply."""
    return path_of(device) == "warp"


class Kernels:
    """A family's kernels on one path, as functions of contiguous tensors and numbers."""

    def __init__(self, family: str, path: str):
        self._module = importlib.import_module(f"{__package__}.{family}_{path}")
        self._of_arrays = path == "numba"
        if self._of_arrays:
            _forget_outdated()

    def __getattr__(self, name: str) -> Callable[..., object]:
        kernel = getattr(self._module, name)
        if self._of_arrays:
            kernel = _taking_tensors(kernel)
        setattr(self, name, kernel)
        return kernel


@cache
def _forget_outdated() -> None:
    from .kept import forget_outdated

    forget_outdated()


def _taking_tensors(kernel: Callable[..., object]) -> Callable[..., object]:
    def run(*arguments) -> object:
        return kernel(*(array_of(a) if isinstance(a, Tensor) else a for a in arguments))

    return run


def array_of(tensor: Tensor) -> np.ndarray:
    """The same memory; without `detach` where that is not needed, which takes as long as a small kernel."""
    return tensor.detach().numpy() if tensor.requires_grad else tensor.numpy()


@cache
def _family_on(family: str, path: str) -> Kernels:
    return Kernels(family, path)


def kernels(family: str, device: torch.device) -> Kernels:
    """The kernels of a family for tensors on a device that is `fast`."""
    return _family_on(family, path_of(device))


def precise(device: torch.device) -> torch.dtype:
    """The type for long sums: double where the device has it."""
    return torch.float32 if device.type == "mps" else torch.float64


@contextlib.contextmanager
def forced_path(path: str) -> Iterator[None]:
    """Within this block every computation takes 'numba', 'warp' or 'torch' (tests and benchmarks)."""
    before = _state["path"]
    _state["path"] = path
    try:
        yield
    finally:
        _state["path"] = before


def plain_torch():
    """Within this block every computation takes the plain torch twin (tests and benchmarks)."""
    return forced_path("torch")


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


def gradient_in_place(tensor: Tensor) -> Tensor | None:
    """The gradient of an input that a backward pass may add to where it lies; None: it may not."""
    if not (_state["in_place"] and tensor.is_leaf):
        return None
    if tensor.grad is None:
        tensor.grad = torch.zeros_like(tensor)
    return tensor.grad


def gradient_buffer(tensor: Tensor) -> tuple[Tensor, Tensor | None]:
    """Where a backward pass may add the gradient of an input, and what it then has to return."""
    lying = gradient_in_place(tensor)
    if lying is not None:
        return lying, None
    buffer = torch.zeros_like(tensor)
    return buffer, buffer
