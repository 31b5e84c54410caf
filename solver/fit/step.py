"""What a step is made of: random pixels, cut into chunks, and the gradients of these."""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from ..kernels.backend import gradients_in_place
from ..kernels.sending import sent
from ..render.random_numbers import RandomNumbers
from ..render.scene import Scene, SharedTables
from .chunk import Chunk, ChunkLoss, Taken
from .ray_bank import RayBank

Step = tuple[list[Chunk], Sequence[Tensor | None]]
"""chunks of a step and the turns of the light that they are under"""


class StepPlan(NamedTuple):
    """All of a step but its random numbers; steps that are replayed have it in common."""

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


class Drawn(NamedTuple):
    """The random pixels of a step."""

    pixels: Tensor  # [P] long, of the bank
    colours: Tensor | None  # [P, 3] sRGB behind the object, where it is random
    turns: Sequence[Tensor | None]  # [3, 3] of the light, those that `Chunk.turn` counts


class StepPixels:
    """Draws the pixels of steps and makes chunks of them.

    Args: see `Trainer`.
    """

    def __init__(self, bank: RayBank, background: str, turns: Tensor | None, generator: torch.Generator):
        self._bank, self._background, self._turns = bank, background, turns
        self._generator = generator

    def draw(self, sizes: list[int]) -> Drawn:
        """Random pixels of chunks of so many each."""
        pixels, colours, turns, photos = [], [], [None], [None] * len(sizes)
        if self._turns is not None:
            # A chunk has one light, and so the pixels of one photo.
            photos = [self._bank.draw_photo(self._generator) for _ in sizes]
            turns = [self._turns[photo] for photo in photos]
        for size, photo in zip(sizes, photos, strict=True):
            pixels.append(self._bank.draw(size, self._generator, photo))
            if self._background == "random":
                colours.append(torch.rand(size, 3, generator=self._generator))
        colours = sent(torch.cat(colours), self._bank.device) if colours else None
        return Drawn(torch.cat(pixels), colours, turns)

    def chunks(
        self, plan: StepPlan, drawn: Drawn, random: RandomNumbers, log_gain: Tensor | None
    ) -> list[Chunk]:
        """Chunks of the pixels drawn, with grid × grid rays each.

        Args:
            random: of the step. log_gain: [photos, C] of the photos' exposures, where those are found.
        """
        sizes = plan.sizes
        # All rays at once, which is faster, and then cut.
        batches = self._bank.batch(drawn.pixels, plan.grid).split(sizes)
        keys = torch.arange(len(drawn.pixels), device=drawn.pixels.device).split(sizes)
        colours = [None] * len(sizes) if drawn.colours is None else drawn.colours.split(sizes)
        rows = zip(batches, keys, colours, plan.shares, plan.retraced, strict=True)
        return [
            Chunk(
                batch, own, colour, log_gain, share, retraced, random, plan.fraction,
                min(index, len(drawn.turns) - 1),
            )
            for index, (batch, own, colour, share, retraced) in enumerate(rows)
        ]  # fmt: skip


def add_gradients(
    scene: Scene, loss: ChunkLoss, chunks: list[Chunk], turns: Sequence[Tensor | None] = (None,)
) -> list[Taken]:
    """Add the gradients of all chunks, one after the other, to those of a scene.

    Kernels share their loops among the cores. Chunks side by side, a thread for each, brought less, since
    each holds Python's lock for as long as it takes two cores to do the rest (docs/decisions/0009).

    Args:
        turns: [3, 3] of the light, those that `Chunk.turn` counts.
    """
    tables = SharedTables.of(scene, turns)
    shared = tables.cut()
    # A thread of its own for a card's backward passes costs an eighth of a step in waiting for Python.
    with gradients_in_place(), torch.autograd.set_multithreading_enabled(False):
        taken = [loss.accumulate(scene, shared.under(chunk.turn), chunk) for chunk in chunks]
        tables.carry(shared)
    return taken
