"""Steps of a fit on a card as CUDA graphs: launched as a whole, without Python in between.

A step is some eight hundred launches of kernels, most of which take a few microseconds; Python needs five
times as long to ask for them (docs/decisions/0034). A graph asks once, for as long as a period lasts in
which steps differ in nothing but their random numbers. For that its arrays have lengths that are reserved
after what the period's first step, an ordinary one, had in them (`kernels.flat_form`).
"""

from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial

import torch
from torch import Tensor

from ..kernels.backend import on_warp
from ..kernels.flat_form import UnlikeObserved, observed, reserved
from .card import Card, CudaGraph
from .chunk import Taken
from .step import StepPlan

MARGIN = 1.2
"""reserved lengths, by the most that was seen in the period before or its own first step"""
SPARE = 256
"""items of a flat form beyond that"""


Inputs = tuple[Tensor | None, ...]
Compute = Callable[..., list[Taken]]


class Replay:
    """Computes gradients of steps, after a period's first two by replaying a graph.

    Attributes:
        plan: of the period, None before its first step.
        failed: why there are no graphs, None if there are.
    """

    def __init__(self, device: torch.device):
        self.plan: StepPlan | None = None
        self.failed: str | None = None
        self._device, self._card = device, Card(device)
        self._lengths: list[int] | None = None
        self._seen: list[int] = []
        self._most: Tensor | None = None
        self._refused = False
        self._graph: CudaGraph | None = None
        self._ended: CudaGraph | None = None
        self._inputs: Inputs = ()

    @property
    def replays(self) -> bool:
        """True if the last step was one that was replayed, or its graph was made for it."""
        return self._graph is not None

    def stream(self) -> AbstractContextManager[None]:
        """Within this block steps can be replayed."""
        return self._card.stream()

    def told_before(self, value: Tensor) -> float:
        return self._card.told_before(value)

    def forget(self) -> None:
        """End the period: what steps read, or what they do, is going to be something else."""
        if self._graph is not None:
            self._seen = self._most.tolist()
            # As long as it is there, its memory is kept for the next one.
            self._graph.end()
            self._ended = self._graph
        self.plan, self._graph, self._inputs = None, None, ()

    def release(self) -> None:
        """End the period and give back what memory graphs have."""
        self.forget()
        self._ended = None
        self._card.release()

    def begin(self, plan: StepPlan) -> None:
        self.forget()
        self.plan, self._lengths, self._refused = plan, None, False

    def run(
        self, compute: Compute, undo: Callable[[], None], *inputs: Tensor | None
    ) -> tuple[list[Taken], bool]:
        """What `compute` finds for tensors, and whether its counts are those of this step.

        Args:
            compute: it has to do the same for all steps of a period, but for the values of its inputs.
            undo: undoes what `compute` has done so far, where memory was too short for it beside graphs.
        """
        if self.failed is not None or self._refused:
            return compute(*inputs), True
        if self._lengths is None:
            try:
                return self._observe(compute, inputs), True
            except torch.OutOfMemoryError as error:
                self.failed = str(error)
            self.release()
            undo()
            return compute(*inputs), True
        if self._graph is None and not self._record(compute, inputs):
            return compute(*inputs), True
        for own, new in zip(self._inputs, inputs, strict=True):
            if own is not None:
                own.copy_(new)
        return self._graph.replay(), False

    def _observe(self, compute: Compute, inputs: Inputs) -> list[Taken]:
        """An ordinary step, after which lengths are reserved."""
        with observed() as totals:
            found = compute(*inputs)
        # What there is of a thing now may be little for what comes.
        seen = self._seen if len(self._seen) == len(totals) else totals
        self._lengths = [int(MARGIN * max(pair)) + SPARE for pair in zip(totals, seen, strict=True)]
        return found

    def _record(self, compute: Compute, inputs: Inputs) -> bool:
        """Make the period's graph; False if that cannot be."""
        self._inputs = tuple(None if value is None else value.clone() for value in inputs)
        self._most = torch.zeros(len(self._lengths), dtype=torch.long, device=self._device)
        try:
            self._graph = self._card.graph(partial(self._within_lengths, compute))
        except UnlikeObserved:
            # What a step does depends on what it finds; the next period may be another.
            self._refused = True
        except RuntimeError as error:
            # Memory may be short, or an operation one that no graph can have: steps go on one by one.
            self.failed = str(error)
        self._ended = None
        if self.failed is not None:
            self.release()
        return self._graph is not None

    def _within_lengths(self, compute: Compute) -> list[Taken]:
        with reserved(self._lengths) as totals:
            found = compute(*self._inputs)
        torch.maximum(self._most, torch.cat(totals), out=self._most)
        return found


def replay_for(device: torch.device) -> Replay | None:
    """Graphs for a device, if it is a card that has kernels which need not be waited for."""
    return Replay(device) if device.type == "cuda" and on_warp(device) else None
