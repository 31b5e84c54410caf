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

_WARP_TYPES = {float: wp.float32, int: wp.int32, bool: wp.bool}


def launch(kernel: wp.Kernel, dim: int | tuple[int, ...], *arguments) -> None:
    """Run `kernel` on `dim` threads; arguments are contiguous tensors of one device, and numbers."""
    device = next(a.device for a in arguments if isinstance(a, torch.Tensor))
    values = [
        _array(a, expected) if isinstance(a, torch.Tensor) else a
        for a, expected in zip(arguments, kernel.adj.args, strict=True)
    ]
    stream = wp.stream_from_torch(device) if device.type == "cuda" else None
    wp.launch(
        kernel, dim, values, device=wp.device_from_torch(device), stream=stream, record_tape=False
    )  # fmt: skip


def _array(tensor: torch.Tensor, expected: wp.codegen.Var):
    # `return_ctype` saves time but looks at no types: a double would be read as two floats.
    wanted = _WARP_TYPES.get(expected.type.dtype, expected.type.dtype)
    if wanted is not wp.dtype_from_torch(tensor.dtype):
        raise TypeError(f"{expected.label}: {tensor.dtype} instead of {wanted.__name__}")
    return wp.from_torch(tensor.detach(), return_ctype=True)


@wp.kernel
def _touch(values: wp.array(dtype=wp.float32)):
    values[wp.tid()] = 1.0


def runs_on(device: torch.device) -> bool:
    """True if Warp can use a device of torch's, which its driver or its age may forbid."""
    values = torch.zeros(1, device=device)
    try:
        launch(_touch, 1, values)
    except Exception:
        return False
    return bool(values[0] == 1)
