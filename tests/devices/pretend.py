"""A graphics card that is none: tensors in ordinary memory that say they lie on CUDA or on Metal.

Where there is no card, `pretended` lets the solver run as on one, and collects what a real one would refuse:

- an operation on tensors of both the device and the processor, where torch does not allow it;
- `numpy()` of a tensor that lies on the device, and random numbers there by a generator of the processor;
- doubles on Metal, which has none;
- a Warp kernel that gets tensors of the processor. On a pretended device Warp runs on the processor.

It does not find what only the hardware knows: operations or types (but doubles) that a device lacks, numbers
that come out otherwise there, Warp's code for cards (`tests/kernels/test_cuda_compiles.py`), memory that
runs out, needless waiting and speed. Two cards, and sparse or complex tensors, are beyond it.

Below Python torch takes these tensors for ones of the processor. So functions that move tensors or make
them on a device are caught before, by a `TorchFunctionMode`; all other operations, those of backward passes
included, arrive at `Placed.__torch_dispatch__`, which looks for mixing and runs them on the plain numbers.
"""

from __future__ import annotations

import contextlib
import threading
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from unittest.mock import patch

import torch
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import TorchDispatchMode

from solver.fit import replay
from solver.kernels import backend, sending, warp_device
from solver.light import environment, irradiance, spherical_harmonics
from solver.render import nested
from solver.render.nested import mapped, tensors_of

ROOT = Path(__file__).resolve().parents[2]
MEMORY = 48e9
"""of the card, bytes"""
LINES = 4
"""of the source that a problem is told with, the innermost first"""
FACTORIES = (
    "arange", "as_tensor", "empty", "eye", "full", "linspace", "ones", "rand", "randint", "randn",
    "tensor", "zeros",
)  # fmt: skip
"""functions of torch's that may make a tensor on a device inside others that are written in Python"""
FILLING = {"fill_", "fill", "masked_fill", "masked_fill_"}
"""operations that take one number from the processor, as those that go element by element do"""
CACHES = (
    environment._map_constants, irradiance.patches, irradiance._corners,
    spherical_harmonics.quadratic_form, sending.constant_on,
)  # fmt: skip
"""of tensors by their device: none made for a pretended one may come to a real one, nor the other way"""
INDEXING = {"index", "index_put", "index_put_", "_index_put_impl_", "_unsafe_index"}
"""operations that take indices from the processor"""
ENGINE = torch.autograd.graph.__file__
"""where a backward pass calls what is not written in Python"""


def _is_ours(file: str) -> bool:
    used_here = file in (__file__, nested.__file__)
    return not used_here and file.startswith((f"{ROOT / 'solver'}", f"{ROOT / 'tests'}"))


class Problems(dict[str, None]):
    """What a real device would have refused, once each, in order."""

    def add(self, what: str) -> None:
        """Note a problem with the lines that it came from."""
        stack = [(frame.f_code.co_filename, line) for frame, line in traceback.walk_stack(None)]
        lines = [f"{Path(f).relative_to(ROOT)}:{line}" for f, line in stack if _is_ours(f)]
        self[f"{what} at {' < '.join(lines[:LINES])}"] = None

    def __str__(self) -> str:
        return "\n".join(self)


problems = Problems()
"""of the device that is pretended now, or was last"""


class Placed(torch.Tensor):
    """A tensor that says it lies on a device; `numbers`, a tensor of the processor, has its values."""

    # Or torch would make results into this class by itself, without numbers.
    __torch_function__ = torch._C._disabled_torch_function_impl

    @staticmethod
    def __new__(cls, numbers: torch.Tensor, device: torch.device) -> Placed:
        placed = torch.Tensor._make_wrapper_subclass(
            cls, numbers.shape, numbers.stride(), numbers.storage_offset(), dtype=numbers.dtype
        )
        placed.numbers, placed._device = numbers, device
        if device.type == "mps" and numbers.dtype in (torch.float64, torch.complex128):
            problems.add("a double on Metal")
        return placed

    @property
    def device(self) -> torch.device:
        return self._device

    @classmethod
    def __torch_dispatch__(cls, operation, types, args=(), kwargs=None):
        kwargs = kwargs or {}
        given = [t for part in (args, list(kwargs.values())) for t in tensors_of(part)]
        device = next(tensor.device for tensor in given if isinstance(tensor, Placed))
        if kwargs.get("generator") is not None:
            problems.add(f"{operation} on the device by a generator of the processor")
        if _mixes(operation, args, given):
            shapes = [(tuple(t.shape), t.device.type) for t in given]
            problems.add(f"{operation} of {shapes}")
        # What is changed in place is the result as well, and not a new tensor.
        same = {id(_numbers(tensor)): tensor for tensor in given}
        result = operation(*mapped(_numbers, args), **{k: mapped(_numbers, v) for k, v in kwargs.items()})

        def placed(made: torch.Tensor) -> torch.Tensor:
            return same[id(made)] if id(made) in same else Placed(made, device)

        return mapped(placed, result)


def _numbers(tensor: torch.Tensor) -> torch.Tensor:
    return tensor.numbers if isinstance(tensor, Placed) else tensor


def _mixes(operation: torch._ops.OpOverload, args: tuple, given: list[torch.Tensor]) -> bool:
    """True if a device would refuse what an operation is given for the processor's tensors in it."""
    name = operation.overloadpacket.__name__
    if name == "copy_":
        return False
    if not isinstance(args[0], Placed) and operation._schema.is_mutable:
        return True
    if name in INDEXING:
        given = tensors_of([args[0], *args[2:]])
    elif torch.Tag.pointwise not in operation.tags and name not in FILLING:
        return not all(isinstance(tensor, Placed) for tensor in given)
    return any(tensor.dim() > 0 for tensor in given if not isinstance(tensor, Placed))


class _Moved(torch.autograd.Function):
    """A copy of a tensor on a device or, None, on the processor; its gradient goes the other way."""

    @staticmethod
    def forward(ctx, tensor, device):
        ctx.source = tensor.device if isinstance(tensor, Placed) else None
        numbers = _numbers(tensor).clone()
        return numbers if device is None else Placed(numbers, device)

    @staticmethod
    def backward(ctx, cotangent):
        return _Moved.apply(cotangent, ctx.source), None


class _ZerosOfAutograd(TorchDispatchMode):
    """Within a backward pass on a device, torch's own zeros, for what got no gradient, lie there."""

    def __init__(self, device: torch.device):
        super().__init__()
        self.device = device

    def __torch_dispatch__(self, operation, types, args=(), kwargs=None):
        made = operation(*args, **(kwargs or {}))
        if operation is not torch.ops.aten.zeros.default:
            return made
        files = [frame.f_code.co_filename for frame, _ in traceback.walk_stack(None)]
        callers = [f for f in files if f == ENGINE or _is_ours(f)]
        return Placed(made, self.device) if callers[0] == ENGINE else made


class Pretence(TorchFunctionMode):
    """Does for a pretended device what torch would do for a real one before any operation runs."""

    def __init__(self, device: torch.device):
        super().__init__()
        self.device = device

    def __torch_function__(self, function: Callable, types, args=(), kwargs=None):
        kwargs, name = dict(kwargs or {}), function.__name__
        placed = bool(args) and isinstance(args[0], Placed)
        if name == "backward" and tensors_of(args)[0].device == self.device:
            with _ZerosOfAutograd(self.device):
                return function(*args, **kwargs)
        if name == "to":
            return self._moved(*args, **kwargs)
        if name == "cpu":
            return self._moved(args[0], "cpu")
        if placed and name in ("numpy", "__array__", "tolist"):
            if name != "tolist":
                problems.add(f"{name}() of a tensor on the device")
            return function(args[0].numbers.detach(), *args[1:], **kwargs)
        if placed and name == "new_tensor" and kwargs.get("device") is None:
            kwargs = {"device": self.device, **kwargs}
        if kwargs.get("device") is not None:
            return self._made(function, args, **kwargs)
        return function(*args, **kwargs)

    def _moved(
        self, tensor, *wanted, device=None, dtype=None, copy=False, non_blocking=False, **_
    ) -> torch.Tensor:
        for value in wanted:
            if isinstance(value, torch.Tensor):
                device, dtype = value.device, value.dtype
            elif isinstance(value, torch.dtype):
                dtype = value
            elif isinstance(value, str | torch.device):
                device = value
        target = tensor.device if device is None else torch.device(device)
        if non_blocking and "mps" in (target.type, tensor.device.type):
            problems.add("a tensor moved to or from Metal, which may read it when it is another's")
        if _graph["replays"] and target.type != tensor.device.type:
            problems.add(f"a tensor moved to {target.type} within a graph")
        dtype = dtype or tensor.dtype
        if target.type == tensor.device.type:
            return tensor.to(dtype, copy=copy)
        # Types are converted on the processor, which has them all.
        if target.type == self.device.type:
            return _Moved.apply(tensor.to(dtype), self.device)
        return _Moved.apply(tensor, None).to(dtype)

    def _made(self, function, args, device, requires_grad=False, **kwargs) -> torch.Tensor:
        there = torch.device(device).type == self.device.type
        if _graph["replays"] and there and function.__name__ in ("tensor", "as_tensor"):
            problems.add(f"{function.__name__} of numbers on the device within a graph")
        if function.__name__ == "as_tensor" and isinstance(args[0], torch.Tensor):
            return self._moved(*args, device=device, **kwargs)
        if there and kwargs.get("generator") is not None:
            problems.add(f"{function.__name__} on the device by a generator of the processor")
        made = function(*mapped(_numbers, args), device="cpu", **kwargs)
        return (Placed(made, self.device) if there else made).requires_grad_(requires_grad)

    def again(self, function: Callable) -> Callable:
        """The function, with this mode on where it is off: in what torch itself has written in Python."""

        def called(*args, **kwargs):
            with self:
                return function(*args, **kwargs)

        return called


class CalledAgain:
    """A graph that is none: it does once more what is asked for, and must not move tensors meanwhile."""

    def __init__(self, call: Callable):
        self._call = call

    def replay(self) -> object:
        """See `CudaGraph`."""
        _graph["replays"] = True
        try:
            return self._call()
        finally:
            _graph["replays"] = False

    def end(self) -> None:
        """See `CudaGraph`."""


class PretendedCard:
    """Stands for `solver.fit.card.Card`."""

    graph = CalledAgain

    def __init__(self, device: torch.device):
        self._before: torch.Tensor | None = None

    def stream(self) -> contextlib.AbstractContextManager[None]:
        """See `Card`."""
        return contextlib.nullcontext()

    def release(self) -> None:
        """See `Card`."""

    def told_before(self, value: torch.Tensor) -> float:
        """See `Card`."""
        before, self._before = self._before, value.clone()
        return float(value if before is None else before)


_graph = {"replays": False}


@contextlib.contextmanager
def pretended(kind: str, with_warp: bool = True) -> Iterator[None]:
    """Within this block there is a device 'cuda' or 'mps'; at its end there must have been no problems.

    Args:
        with_warp: it is one that Warp runs on, if it is of CUDA.
    """

    def place(tensor, name, wanted):
        if not isinstance(tensor, Placed):
            problems.add(f"a Warp kernel gets '{name}' of the processor")
        return place_of(_numbers(tensor), name, wanted)

    def of_warp(device):
        if device.index is None:
            raise TypeError("Warp knows cards by their numbers alone")
        return "cpu"

    place_of, module_options = warp_device.place_of, torch.__future__
    before = module_options.get_overwrite_module_params_on_conversion()
    availability = torch.cuda if kind == "cuda" else torch.backends.mps
    problems.clear()
    with contextlib.ExitStack() as stack:
        stack.enter_context(patch.object(availability, "is_available", lambda: True))
        memory = patch.object(torch.cuda, "mem_get_info", lambda device: (MEMORY, MEMORY))
        stack.enter_context(memory)
        stack.enter_context(
            patch.object(backend, "trouble_with_warp", lambda device: "" if with_warp else "none")
        )
        stack.enter_context(patch.object(warp_device, "place_of", place))
        stack.enter_context(patch.object(warp_device.wp, "device_from_torch", of_warp))
        stack.enter_context(patch.object(warp_device, "_stream", lambda device: None))
        stack.enter_context(patch.object(warp_device, "_launches", threading.local()))
        stack.enter_context(patch.object(replay, "Card", PretendedCard))
        # A module's parameter becomes another when it moves: it cannot change its class.
        module_options.set_overwrite_module_params_on_conversion(True)
        stack.callback(module_options.set_overwrite_module_params_on_conversion, before)
        for cache in CACHES:
            cache.cache_clear()
            stack.callback(cache.cache_clear)
        with torch.device("cpu"):
            torch.empty(0)  # torch now lists its factories, which later are others
        pretence = stack.enter_context(Pretence(torch.device(kind, 0)))
        for name in FACTORIES:
            stack.enter_context(patch.object(torch, name, pretence.again(getattr(torch, name))))
        try:
            yield
        except Exception as error:
            error.add_note(f"Problems before:\n{problems}")
            raise
    assert not problems, f"{kind}:\n{problems}"
