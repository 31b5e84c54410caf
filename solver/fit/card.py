"""An NVIDIA card's stream, its graphs with their memory, and numbers that are read late."""

import contextlib
import gc
from collections.abc import Callable, Iterator

import torch

from .chunk import Taken

Call = Callable[[], list[Taken]]


class Card:
    """A card on which graphs are made (see `replay`)."""

    def __init__(self, device: torch.device):
        self._device = device
        self._stream = torch.cuda.Stream(device)
        self._pool = torch.cuda.graph_pool_handle()
        self._told = [torch.zeros(1).pin_memory() for _ in range(2)]
        self._when = [torch.cuda.Event() for _ in range(2)]
        self._count = 0

    @contextlib.contextmanager
    def stream(self) -> Iterator[None]:
        """Within this block all is done on the stream that graphs are made on, after what was asked for
        before it and before what is asked for after it."""
        around = torch.cuda.current_stream(self._device)
        self._stream.wait_stream(around)
        try:
            with torch.cuda.stream(self._stream):
                yield
        finally:
            around.wait_stream(self._stream)

    def graph(self, call: Call) -> "CudaGraph":
        """What a call does, to be done again. Earlier graphs, if there are any, must not be replayed
        afterwards: it has their memory.

        Raises:
            RuntimeError: it cannot be one, or `call` has raised that.
        """
        try:
            return CudaGraph(call, self._pool)
        except BaseException:
            self._abandon()
            raise

    def _abandon(self) -> None:
        """Let memory be as if nothing had been begun, where what a call did has ended a recording."""
        with contextlib.suppress(AttributeError, RuntimeError):
            torch._C._cuda_endAllocateToPool(self._stream.device_index, self._pool)
        self._pool = torch.cuda.graph_pool_handle()

    def release(self) -> None:
        """Give back the memory of graphs that are gone."""
        gc.collect()
        torch.cuda.empty_cache()
        self._pool = torch.cuda.graph_pool_handle()

    def told_before(self, value: torch.Tensor) -> float:
        """The number that this was called with the last time, which need not be waited for; the first time,
        this one."""
        now, before = self._count % 2, (self._count - 1) % 2 if self._count > 0 else 0
        self._told[now].copy_(value.view(1), non_blocking=True)
        self._when[now].record()
        self._count += 1
        self._when[before].synchronize()
        return float(self._told[before])


class CudaGraph:
    """What a call does on the card, done again by `replay`; its tensors stay where they are.

    Args:
        pool: of memory, shared with graphs that are not replayed any more.
    """

    def __init__(self, call: Call, pool: object):
        self._graph = torch.cuda.CUDAGraph()
        # What is freed meanwhile could be what a call to the driver may not free now.
        collects = gc.isenabled()
        gc.disable()
        try:
            self._graph.capture_begin(pool, capture_error_mode="thread_local")
            try:
                self.found = call()
            except BaseException:
                # That the recording has come to nothing is not what there is to tell.
                with contextlib.suppress(RuntimeError):
                    self._graph.capture_end()
                raise
            self._graph.capture_end()
        finally:
            if collects:
                gc.enable()

    def replay(self) -> list[Taken]:
        """Do it again; what it finds is overwritten by the next time."""
        self._graph.replay()
        return self.found

    def end(self) -> None:
        """Let its memory be another's; it is not replayed any more."""
        self.found = None
