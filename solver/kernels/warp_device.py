"""How kernels written in Warp meet torch's tensors, on CUDA and, for tests, on the CPU.

Warp (https://github.com/NVIDIA/warp) compiles at run time with what its wheel brings along, so nobody
needs a CUDA toolkit. Kernels run on torch's current stream, in order with torch's own.
"""

from __future__ import annotations

import ctypes
import threading
from functools import cache

import torch
import warp as wp

# Its greeting would stand among what programs read from our output.
wp.config.log_level = wp.LOG_ERROR
wp.init()

_Array = type(wp.from_torch(torch.zeros(1), return_ctype=True))


def launch(kernel: wp.Kernel, dim: int | tuple[int, ...], *arguments) -> None:
    """Run `kernel` on `dim` threads; arguments are contiguous tensors of one device, and numbers."""
    _run(kernel, dim, arguments)


def launch_adjoint(
    kernel: wp.Kernel, dim: int | tuple[int, ...], arguments: tuple, cotangents: tuple
) -> None:
    """Run the adjoint that Warp derives of a kernel, whose outputs are among its arguments.

    Args:
        cotangents: tensors as the arguments: of an input, what is added to; of an output, what is
            given; or None.
    """
    _run(kernel, dim, arguments, cotangents)


_commands = threading.local()
"""of a thread: launches by kernel and device, for making one anew takes Warp longer than all the rest"""


def _run(kernel: wp.Kernel, dim, arguments: tuple, cotangents: tuple | None = None) -> None:
    if dim == 0 or (isinstance(dim, tuple) and 0 in dim):
        return
    device = next(a.device for a in arguments if isinstance(a, torch.Tensor))
    known = _commands.__dict__.setdefault("by_kernel", {})
    key = kernel, device, cotangents is not None
    if key not in known:
        known[key] = wp.launch(
            kernel, dim, _arrays(kernel, arguments), device=wp.device_from_torch(device),
            adj_inputs=_arrays(kernel, cotangents or ()), adjoint=cotangents is not None,
            record_tape=False, record_cmd=True,
        )  # fmt: skip
    command = known[key]
    command.set_dim(dim)
    for adjoint, values in ((False, arguments), (True, cotangents or ())):
        for index, value in enumerate(_arrays(kernel, values)):
            if isinstance(value, ctypes.Structure):
                command.set_param_at_index_from_ctype(index, value, adjoint)
            elif value is not None:
                command.set_param_at_index(index, value, adjoint)
    command.launch(_stream(device) if device.type == "cuda" else None)


def _stream(device: torch.device) -> wp.Stream:
    current = torch.cuda.current_stream(device)
    return _stream_of(device, current.cuda_stream)


@cache
def _stream_of(device: torch.device, address: int) -> wp.Stream:
    return wp.Stream(wp.device_from_torch(device), cuda_stream=address)


def _arrays(kernel: wp.Kernel, values: tuple) -> list:
    """The values that a kernel is given, with tensors as what Warp calls arrays."""
    return [
        _array(value, *wanted) if isinstance(value, torch.Tensor) else value
        for value, wanted in zip(values, _types(kernel), strict=False)
    ]


@cache
def _types(kernel: wp.Kernel) -> list[tuple[str, torch.dtype | None]]:
    """Names of a kernel's arguments, and the type of those that are arrays."""
    return [
        (a.label, wp.dtype_to_torch(a.type.dtype) if isinstance(a.type, wp.array) else None)
        for a in kernel.adj.args
    ]


def _array(tensor: torch.Tensor, name: str, wanted: torch.dtype | None) -> ctypes.Structure:
    # What Warp is told is where and how large it is: no types, so that a double would be read as two
    # floats, and no owner, for work on a stream is done before its memory is used again there.
    if tensor.dtype is not wanted:
        raise TypeError(f"{name}: {tensor.dtype} instead of {wanted}")
    size = tensor.element_size()
    strides = tuple(stride * size for stride in tensor.stride())
    return _Array(tensor.data_ptr(), 0, tensor.dim(), tuple(tensor.shape), strides)


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
