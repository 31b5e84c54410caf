"""The paths that kernels exist for, each with a device to try it on."""

import pytest
import torch

WITHOUT_CARD = pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA")

PATHS = [
    pytest.param("numba", "cpu", id="numba"),
    pytest.param("warp", "cpu", id="warp-cpu"),
    pytest.param("warp", "cuda", id="warp-cuda", marks=WITHOUT_CARD),
]


def to_device(arguments, device):
    """Tensors among the arguments moved to a device, as leaves where they were leaves."""
    return tuple(
        a.detach().to(device).requires_grad_(a.requires_grad) if isinstance(a, torch.Tensor) else a
        for a in arguments
    )
