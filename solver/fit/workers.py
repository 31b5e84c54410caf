"""Chunks of a step side by side, on all cores: threads whose scenes share memory but not gradients.

Kernels and torch let go of Python's lock, so threads do. Most of a step is many small operations,
which use several cores well only in this way (measured in docs/decisions/0009).
"""

from __future__ import annotations

import copy
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import TypeVar

import numba
import torch
from torch import nn

from ..kernels.backend import gradients_in_place, on_warp
from ..render.scene import Scene, SharedTables
from .chunk import Chunk, ChunkLoss, Taken

Result = TypeVar("Result")

TURN = 5e-4
"""seconds after which a thread that waits for Python's lock gets it; Python's own 5 ms are longer than
most of what a step does, and cost a tenth of it"""


def sharing(scene: Scene) -> Scene:
    """A scene with the same parameters and grids in memory, but gradients of its own."""
    memo: dict[int, object] = {
        id(p): nn.Parameter(p.detach(), p.requires_grad) for p in scene.parameters()
    }
    memo |= {id(buffer): buffer for buffer in scene.buffers()}
    memo[id(scene.occupancy)] = scene.occupancy
    memo[id(scene.probes)] = scene.probes
    return copy.deepcopy(scene, memo)


def worker_count(device: torch.device) -> int:
    """Threads worth having: as many as numba uses, where its threading layer may be used by several.

    One where kernels are Warp's, also on the processor, where only tests have them: it compiles them when
    they are first launched, and nothing says that two threads may do so at once.
    """
    if device.type != "cpu" or on_warp(device):
        return 1
    try:
        layer = numba.threading_layer()
    except ValueError:
        # Nothing has run in parallel yet, so nobody knows.
        return 1
    return numba.get_num_threads() if layer in ("omp", "tbb") else 1


class Workers:
    """Threads for the chunks of a step, and a scene for each.

    Args:
        scene: the first worker's; it is where gradients are gathered. loss: of a chunk.
        count: of workers.
    """

    def __init__(self, scene: Scene, loss: ChunkLoss, count: int = 1):
        self.loss = loss
        self.scenes = [scene, *(sharing(scene) for _ in range(count - 1))]
        self._pool = None
        if count > 1:
            sys.setswitchinterval(min(sys.getswitchinterval(), TURN))
            self._pool = ThreadPoolExecutor(count, initializer=_one_thread)

    def gradients(
        self, chunks: list[Chunk], turns: Sequence[torch.Tensor | None] = (None,)
    ) -> list[Taken]:
        """Add the gradients of all chunks to those of the scene; worker w takes chunks w, w + count, …

        Args:
            turns: [3, 3] of the light, those that `Chunk.turn` counts.
        """
        tables = SharedTables.of(self.scenes[0], turns, self.together)
        count = len(self.scenes)
        copies = [tables.cut() for _ in range(count)]
        # A thread of its own for a card's backward passes costs an eighth of a step in waiting for Python.
        with gradients_in_place(), torch.autograd.set_multithreading_enabled(False):
            shares = self.together(
                [partial(self._share, worker, copies[worker], chunks[worker::count])
                 for worker in range(count)]
            )  # fmt: skip
            self._gather()
            self.together(tables.carries(copies))
        return [shares[index % count][index // count] for index in range(len(chunks))]

    def _share(self, worker: int, tables: SharedTables, chunks: list[Chunk]) -> list[Taken]:
        return [
            self.loss.accumulate(self.scenes[worker], tables.under(chunk.turn), chunk)
            for chunk in chunks
        ]

    def _gather(self) -> None:
        """Add all workers' gradients to the first one's, in the order of the workers, and clear them."""
        copies = zip(*(scene.parameters() for scene in self.scenes), strict=True)
        self.together([partial(_gather, *same) for same in copies])

    def together(self, calls: list[Callable[[], Result]]) -> list[Result]:
        """Results of calls that have nothing to do with each other, the longest first."""
        if self._pool is None:
            return [call() for call in calls]
        return list(self._pool.map(lambda call: call(), calls))

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()


def _gather(mine: nn.Parameter, *others: nn.Parameter) -> None:
    for theirs in others:
        if theirs.grad is None:
            continue
        if mine.grad is None:
            mine.grad = theirs.grad.clone()
        else:
            mine.grad.add_(theirs.grad)
        # Not thrown away: a new one would have to be fetched from the system page by page.
        theirs.grad.zero_()


def _one_thread() -> None:
    numba.set_num_threads(1)
    torch.set_num_threads(1)
