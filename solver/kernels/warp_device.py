"""How kernels written in Warp meet torch's tensors, on CUDA and, for tests, on the CPU.

Warp (https://github.com/NVIDIA/warp) compiles at run time with what its wheel brings along, so nobody
needs a CUDA toolkit. Kernels run on torch's current stream, in order with torch's own.
"""

import importlib
import threading
from collections.abc import Callable, Iterable
from functools import cache, partial

import torch
import warp as wp
from torch import Tensor

from ..threads import usable_cores
from .warp_folder import kernel_cache

# Its greeting would stand among what programs read from our output.
wp.config.log_level = wp.LOG_ERROR
if (folder := kernel_cache()) is not None:
    wp.config.kernel_cache_dir = str(folder)
wp.init()

_Array = type(wp.from_torch(torch.zeros(1), return_ctype=True))


def launch(kernel: wp.Kernel, dim: int | tuple[int, ...], *arguments) -> None:
    """Run `kernel` on `dim` threads; arguments are tensors of one device, and numbers."""
    _run(kernel, dim, arguments, None)


def launched(kernel: wp.Kernel, over: str, axes: int = 1) -> Callable[..., None]:
    """A function of a kernel's arguments that runs it on a thread for each place of one of them."""
    place = [argument.label for argument in kernel.adj.args].index(over)

    def run(*arguments) -> None:
        launch(kernel, tuple(arguments[place].shape[:axes]), *arguments)

    return run


def launch_adjoint(
    kernel: wp.Kernel, dim: int | tuple[int, ...], arguments: tuple, cotangents: tuple
) -> None:
    """Run the adjoint that Warp derives of a kernel, whose outputs are among its arguments.

    Args:
        cotangents: tensors as the arguments: of an input, what is added to; of an output, what is
            given; or None.
    """
    _run(kernel, dim, arguments, cotangents)


_launches = threading.local()
"""of a thread, since what one has set another must not launch"""


def _run(kernel: wp.Kernel, dim, arguments: tuple, cotangents: tuple | None) -> None:
    if dim == 0 or (isinstance(dim, tuple) and 0 in dim):
        return
    device = _device_of(arguments)
    known = _launches.__dict__.setdefault("known", {})
    key = kernel, device, cotangents is not None
    if key not in known:
        known[key] = _Launch(kernel, device, dim, arguments, cotangents)
    known[key](dim, (*arguments, *(cotangents or ())))


def _device_of(arguments: tuple) -> torch.device:
    return next(a.device for a in arguments if isinstance(a, Tensor))


class _Launch:
    """A kernel on a device, ready to go; to make that anew each time takes longer than most kernels do.

    Args:
        cotangents: those of the arguments, for the kernel's adjoint.
    """

    def __init__(
        self, kernel: wp.Kernel, device: torch.device, dim, arguments: tuple, cotangents: tuple | None
    ):
        known = kernel.adj.args
        self._parameters = [_Parameter(a.label, a.type) for a in known]
        if cotangents is not None:
            self._parameters += [_Parameter(f"cotangent of {a.label}", a.type) for a in known]
        values = [
            parameter.given(value)
            for parameter, value in zip(self._parameters, (*arguments, *(cotangents or ())), strict=True)
        ]
        self._command = wp.launch(
            kernel, dim, values[: len(known)], adj_inputs=values[len(known) :],
            adjoint=cotangents is not None, device=wp.device_from_torch(device), record_cmd=True,
            record_tape=False, block_dim=kernel.module.options["block_dim"],
        )  # fmt: skip
        for index, parameter in enumerate(self._parameters):
            parameter.join(self._command, index % len(known), index >= len(known))
        self._device, self._dim = device, dim

    def __call__(self, dim: int | tuple[int, ...], values: tuple) -> None:
        if dim != self._dim:
            self._dim = dim
            self._command.set_dim(dim)
        for parameter, value in zip(self._parameters, values, strict=True):
            parameter.set(value)
        self._command.launch(_stream(self._device))


class _Parameter:
    """An argument of a launch, or its cotangent, which is told what is new only."""

    def __init__(self, name: str, kind: object):
        self._name, self._value = name, None
        self._array = self._type = None
        if isinstance(kind, wp.array):
            self._array, self._type = _Array(), wp.dtype_to_torch(kind.dtype)

    def given(self, value: Tensor | float | None) -> object:
        """What Warp is given for a value, at first."""
        self.set(value)
        return self._array if isinstance(value, Tensor) else value

    def join(self, command: wp.Launch, index: int, adjoint: bool) -> None:
        """Be a launch's parameter."""
        self._tell = partial(command.set_param_at_index, index, adjoint=adjoint)
        if self._array is not None:
            command.set_param_at_index_from_ctype(index, self._array, adjoint)

    def set(self, value: Tensor | float | None) -> None:
        """Take another value."""
        if isinstance(value, Tensor):
            # All that Warp is told is where and how large it is: no type, so that a double would be read
            # as two floats, and no owner, for memory on a stream is used again after what waits there.
            self._array.data, *layout = place_of(value, self._name, self._type)
            if layout != self._value:
                self._value = layout
                shape, strides = layout
                size = value.element_size()
                self._array.__init__(
                    self._array.data, 0, len(shape), shape, [size * stride for stride in strides]
                )
        elif self._array is not None:
            if value is not None:
                raise TypeError(f"{self._name}: {value} instead of a tensor")
            # Not wanted this time: what it was given before is not to be written to.
            self._array.data = 0
        elif value is not None and value != self._value:
            if self._value is not None:
                self._tell(value)
            self._value = value


def place_of(
    tensor: Tensor, name: str, wanted: torch.dtype | None
) -> tuple[int, tuple[int, ...], tuple[int, ...]]:
    """Address, shape and strides of a tensor of the type wanted.

    Raises:
        TypeError: it is of another.
    """
    if tensor.dtype is not wanted:
        raise TypeError(f"{name}: {tensor.dtype} instead of {wanted}")
    return tensor.data_ptr(), tensor.shape, tensor.stride()


def _stream(device: torch.device) -> wp.Stream | None:
    if device.type != "cuda":
        return None
    return _stream_at(device, torch.cuda.current_stream(device).cuda_stream)


@cache
def _stream_at(device: torch.device, address: int) -> wp.Stream:
    return wp.Stream(wp.device_from_torch(device), cuda_stream=address)


def load(families: Iterable[str], device: torch.device) -> None:
    """Compile all kernels of modules `*_warp` for a device, side by side, and load them; those that were
    compiled on this machine before are found on its disk."""
    modules = [importlib.import_module(f"{__package__}.{family}_warp") for family in families]
    wp.force_load(
        wp.device_from_torch(device), [wp.get_module(module.__name__) for module in modules],
        max_workers=usable_cores(),
    )  # fmt: skip


@wp.kernel
def _touch(values: wp.array(dtype=wp.float32)):
    values[wp.tid()] = 1.0


def trouble_on(device: torch.device) -> str:
    """Why Warp cannot use a device of torch's, which its driver or its age may forbid; empty if it can."""
    values = torch.zeros(1, device=device)
    try:
        launch(_touch, 1, values)
    except Exception as error:
        return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
    return "" if values[0] == 1 else "a kernel did not do what it should"
