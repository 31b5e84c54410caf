"""A chunk of a step: from its rays to the gradients they have for a scene and its tables."""

import dataclasses
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from ..render.pixels import keys_of_rays, pixels_of, secondary_rays_each
from ..render.radiance import RayBuffers, render_rays
from ..render.random_numbers import ROOM_OFFSET, RandomNumbers
from ..render.scene import RenderSettings, Scene, StepTables
from ..render.surroundings import surroundings
from . import priors
from .far_light import FarLight
from .losses import Behind, photometric, room_light, total_loss
from .ray_bank import RayBatch
from .schedule import emission_share, neural_share, pixel_grid
from .settings import Settings

SURROUNDED = ("environment", "room")
"""backgrounds that the scene itself has; photos before them are seen with their surroundings"""
ROOM_DIRECTIONS = 256
"""directions a step in which the light is held to the room, or to what is far away"""


class Chunk(NamedTuple):
    """Pixels that are worked on at once, and how."""

    batch: RayBatch
    keys: Tensor  # [P] long, for random numbers
    colour: Tensor | None  # [P, 3] sRGB behind the object, where it is random
    log_gain: Tensor | None  # [photos, C] logarithms of their exposures, where those are found
    share: float  # of the step's pixels
    retraced: int  # secondary rays to be traced through the field
    random: RandomNumbers  # of the step
    fraction: float  # of the fit done
    turn: int = 0  # which of the step's turns of the light it is under


class Taken(NamedTuple):
    """What came of a chunk, next to gradients."""

    image: Tensor  # its image loss
    samples: tuple[int, int, int]  # density samples, retraced rays, their samples
    to_exposures: Tensor | None  # [photos, C] gradient of their log gains


@dataclass(frozen=True)
class ChunkLoss:
    """The loss of chunks; what it knows stays the same over a fit.

    Attributes: see `Trainer`.
    """

    settings: Settings
    use_masks: bool
    background: str
    fog: bool
    far: FarLight | None = None

    def render_settings(self, fraction: float) -> RenderSettings:
        """Render settings at a fraction of the fit: g is blended out, pixels get more rays (see
        `FitSettings`)."""
        fit, render = self.settings.fit, self.settings.render
        grid = pixel_grid(self.settings, fraction)
        return dataclasses.replace(
            render, pixel_grid=grid,
            secondary_rays=secondary_rays_each(render.secondary_rays, grid),
            widening_gradient=fit.unbiased and grid > 1,
            neural=neural_share(fit, fraction),
            neighbour_distance=fit.neighbour_distance, emission=self.emission(fraction),
        )  # fmt: skip

    def emission(self, fraction: float) -> float:
        """Share of emission at a fraction of the fit."""
        return emission_share(self.settings.fit, fraction) if self.fog else 0.0

    def accumulate(self, scene: Scene, tables: StepTables, chunk: Chunk) -> Taken:
        """Add the gradients of a chunk's share of the loss to those of scene and tables."""
        share, fit = chunk.share, self.settings.fit
        buffers = self.pixels(scene, tables, chunk)
        log_gain = gain = None
        if chunk.log_gain is not None:
            log_gain = chunk.log_gain.clone().requires_grad_()
            gain = log_gain[chunk.batch.photo].exp()
        loss, terms = total_loss(
            buffers, chunk.batch, fit, self.use_masks, chunk.fraction,
            self._behind(scene, tables, chunk), gain,
        )  # fmt: skip
        reflecting = 1 - self.emission(chunk.fraction)
        if reflecting > 0:
            loss = loss + reflecting * priors.of_materials(buffers, fit, chunk.fraction)
        keys = chunk.keys[: max(1, round(ROOM_DIRECTIONS * share))]
        if scene.room is not None:
            loss = loss + fit.room_light_weight * room_light(scene, tables, chunk.random, keys)
        elif self.far is not None:
            difference = self.far.difference(scene, tables, chunk.random, keys)
            loss = loss + fit.room_light_weight * difference
        elif fit.grey_light_weight > 0 and self.background not in SURROUNDED:
            loss = loss + fit.grey_light_weight * priors.coloured_light(tables.light)
        (loss * share).backward()
        samples = (buffers.samples, buffers.retraced, buffers.retraced_samples)
        return Taken(terms["image"], samples, None if log_gain is None else log_gain.grad)

    @torch.no_grad()
    def image_error(self, scene: Scene, tables: StepTables, chunk: Chunk) -> float:
        """A chunk's share of how unlike the photos its pixels are (`losses.photometric`); no gradients."""
        gain = None if chunk.log_gain is None else chunk.log_gain[chunk.batch.photo].exp()
        buffers, behind = self.pixels(scene, tables, chunk), self._behind(scene, tables, chunk)
        return chunk.share * float(photometric(buffers, chunk.batch, behind, gain))

    def pixels(self, scene: Scene, tables: StepTables, chunk: Chunk) -> RayBuffers:
        """What the pixels of a chunk see."""
        batch = chunk.batch
        settings = dataclasses.replace(self.render_settings(chunk.fraction), retraced_rays=chunk.retraced)
        each = batch.directions.shape[1]
        buffers = render_rays(
            scene, tables, settings, chunk.random,
            batch.origins.repeat_interleave(each, 0), batch.directions.flatten(0, 1),
            keys_of_rays(chunk.keys, each), jitter=True,
            pixel_angle=batch.pixel_angle.repeat_interleave(each) / settings.pixel_grid,
        )  # fmt: skip
        return pixels_of(buffers, each, halves=self.settings.fit.unbiased)

    def _behind(self, scene: Scene, tables: StepTables, chunk: Chunk) -> Behind:
        batch = chunk.batch
        if self.background in SURROUNDED:
            u = chunk.random.uniform(ROOM_OFFSET, chunk.keys)
            middle = torch.nn.functional.normalize(batch.directions.mean(1), dim=-1)
            return surroundings(scene, tables, batch.origins, middle, batch.pixel_angle, u)
        if batch.behind is not None:
            return batch.behind
        if chunk.colour is not None:
            return chunk.colour
        return batch.colour.new_full((len(batch.colour), 3), float(self.background != "black"))
