"""How kernels written in Warp meet torch's tensors, on CUDA and, for tests, on the CPU.

Warp (https://github.com/NVIDIA/warp) compiles at run time with what its wheel brings along, so nobody
needs a CUDA toolkit. Kernels run on torch's current stream, in order with torch's own.
"""

from __future__ import annotations

import torch
import warp as wp

# Its greeting would stand among what programs read from our output.
wp.config.log_level = wp.LOG_ERROR
wp.init()


def launch(kernel: wp.Kernel, dim: int | tuple[int, ...], *arguments) -> None:
    """Run `kernel` on `dim` threads; arguments are contiguous tensors of one device, and numbers."""
    device = next(a.device for a in arguments if isinstance(a, torch.Tensor))
    values = [
        wp.from_torch(a.detach(), return_ctype=True) if isinstance(a, torch.Tensor) else a
        for a in arguments
    ]
    stream = wp.stream_from_torch(device) if device.type == "cuda" else None
    wp.launch(
        kernel, dim, values, device=wp.device_from_torch(device), stream=stream, record_tape=False
    )  # fmt: skip
