"""Steps of a fit on a card as CUDA graphs: launched as a whole, without Python in between.

A step is some six hundred launches of kernels, most of which take a few microseconds; Python needs five
times as long to ask for them (docs/decisions/0034). A graph asks once, for as long as a period lasts in
which steps differ in nothing but their random numbers. For that its arrays have lengths that are reserved
after what the period's first step, an ordinary one, had in them (`kernels.flat_form`).
"""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import torch

from ..kernels.backend import on_warp
from ..kernels.flat_form import UnlikeObserved, observed, reserved
from .chunk import Taken

MARGIN = 1.2
"""reserved lengths, by the most that was seen in the period before or its own first step"""
SPARE = 256
"""items of a flat form beyond that"""


class StepPlan(NamedTuple):
    """What the steps of a period have in common."""

    sizes: list[int]  # pixels of each chunk
    grid: int  # rays across a pixel
    retraced: list[int]  # secondary rays of each chunk that are traced through the field
    fraction: float  # of the fit done

    @property
    def rays(self) -> list[int]:
        """Primary rays of each chunk."""
        return [size * self.grid**2 for size in self.sizes]

    @property
    def shares(self) -> list[float]:
        """Of the step's pixels, that each chunk has."""
        return [size / sum(self.sizes) for size in self.sizes]


Inputs = tuple[torch.Tensor | None, ...]
Compute = Callable[..., list[Taken]]


class CudaGraph:
    """What a call does on the card, done again by `replay`; its tensors stay where they are.

    Args:
        pool: of memory, shared with graphs that are not replayed any more.
    """

    def __init__(self, call: Callable[[], list[Taken]], pool: object):
        self._graph = torch.cuda.CUDAGraph()
        # What is freed meanwhile could be what a call to the driver may not free now.
        collects = gc.isenabled()
        gc.disable()
        try:
            self._graph.capture_begin(pool, capture_error_mode="thread_local")
            try:
                self.found = call()
            finally:
                self._graph.capture_end()
        finally:
            if collects:
                gc.enable()

    def replay(self) -> list[Taken]:
        """Do it again; what it finds is overwritten by the next time."""
        self._graph.replay()
        return self.found


class Replay:
    """Computes gradients of steps, after a period's first two by replaying a graph.

    Attributes:
        plan: of the period, None before its first step.
        failed: why there are no graphs, None if there are.
    """

    make_graph = CudaGraph

    def __init__(self, device: torch.device):
        self.plan: StepPlan | None = None
        self.failed: str | None = None
        self._lengths: list[int] | None = None
        self._refused = False
        self._most: torch.Tensor | None = None
        self._seen: list[int] = []
        self._graph: CudaGraph | None = None
        self._ended: CudaGraph | None = None
        self._inputs: Inputs = ()
        self._device = device
        self._stream, self._pool = stream_and_pool(device)

    @property
    def replays(self) -> bool:
        """True if the last step was one that was replayed, or its graph was made for it."""
        return self._graph is not None

    @contextlib.contextmanager
    def stream(self) -> Iterator[None]:
        """Within this block all is done on the stream that graphs are made on, after what was asked for
        before it and before what is asked for after it."""
        if self._stream is None:
            yield
            return
        around = torch.cuda.current_stream(self._device)
        self._stream.wait_stream(around)
        with torch.cuda.stream(self._stream):
            yield
        around.wait_stream(self._stream)

    def forget(self) -> None:
        """End the period: what steps read, or what they do, is going to be something else."""
        if self._graph is not None:
            self._seen = self._most.tolist()
            # While it is there, its memory is the next one's.
            self._graph.found, self._ended = None, self._graph
        self.plan, self._graph, self._inputs = None, None, ()

    def begin(self, plan: StepPlan) -> None:
        """Begin a period."""
        self.forget()
        self.plan, self._lengths, self._refused = plan, None, False

    def run(self, compute: Compute, *inputs: torch.Tensor | None) -> tuple[list[Taken], bool]:
        """What `compute` finds for tensors, and whether its counts are those of this step.

        Args:
            compute: it has to do the same for all steps of a period, but for the values of its inputs.
        """
        if self.failed is not None or self._refused:
            return compute(*inputs), True
        if self._lengths is None:
            with observed() as totals:
                found = compute(*inputs)
            # What there is of a thing now may be little for what comes.
            seen = self._seen if len(self._seen) == len(totals) else totals
            most = map(max, totals, seen)
            self._lengths = [int(MARGIN * count) + SPARE for count in most]
            return found, True
        if self._graph is None and not self._capture(compute, inputs):
            return compute(*inputs), True
        for own, new in zip(self._inputs, inputs, strict=True):
            if own is not None:
                own.copy_(new)
        return self._graph.replay(), False

    def _capture(self, compute: Compute, inputs: Inputs) -> bool:
        """Make the period's graph; False if that cannot be."""
        self._inputs = tuple(None if value is None else value.clone() for value in inputs)
        self._most = torch.zeros(len(self._lengths), dtype=torch.long, device=self._device)
        try:
            self._graph = self.make_graph(partial(self._within_lengths, compute), self._pool)
        except UnlikeObserved:
            # What a step does depends on what it finds; the next period may be another.
            self._refused = True
        except RuntimeError as error:
            # Memory may be short, or an operation one that no graph can have: steps go on one by one.
            self.failed = str(error)
        self._ended = None
        return self._graph is not None

    def _within_lengths(self, compute: Compute) -> list[Taken]:
        with reserved(self._lengths) as totals:
            found = compute(*self._inputs)
        torch.maximum(self._most, torch.cat(totals), out=self._most)
        return found


def stream_and_pool(device: torch.device) -> tuple[torch.cuda.Stream | None, object]:
    """Where graphs of a device are made, and what their memory is of."""
    return torch.cuda.Stream(device), torch.cuda.graph_pool_handle()


def replay_for(device: torch.device) -> Replay | None:
    """Graphs for a device, if it is a card that has kernels which need not be waited for."""
    return Replay(device) if device.type == "cuda" and on_warp(device) else None
