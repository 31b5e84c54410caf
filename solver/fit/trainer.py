"""The optimisation loop's one step, and the state it carries."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import torch

from ..field.smoothing import step_smoothing
from ..kernels.backend import gradients_in_place
from ..render.radiance import render_rays
from ..render.random_numbers import ROOM_OFFSET, RandomNumbers
from ..render.scene import RenderSettings, Scene, StepTables
from ..render.surroundings import surroundings
from .adam import Adam
from .batching import Batching
from .exposure import exposures_for
from .losses import Behind, room_light, total_loss
from .presets import Settings, emission_share, neural_share, smoothing_width, step_width
from .ray_bank import RayBank, RayBatch
from .workers import Workers, worker_count

THIN_FOG_SHARE = 0.02
"""of the opacity from which a cell counts as occupied, while the fog is thin still"""
SURROUNDED = ("environment", "room")
"""backgrounds that the scene itself has; photos before them are seen with their surroundings"""
ROOM_DIRECTIONS = 256
"""directions a step in which the light is held to the room"""


class Chunk(NamedTuple):
    """What a worker does at once."""

    pixels: torch.Tensor  # [R] long, global pixel indices
    keys: torch.Tensor  # [R] long, for random numbers
    colour: torch.Tensor | None  # [R, 3] sRGB behind the object, where it is random


class Taken(NamedTuple):
    """What came of a chunk."""

    image: float  # its image loss
    samples: tuple[int, int, int]  # density samples, retraced rays, their samples
    to_exposures: torch.Tensor | None  # [P, C] gradient of the photos' log gains


class Trainer:
    """Owns the scene's optimiser and its schedule over the fraction of the fit done.

    Args:
        scene: what is fitted, changed in place.
        bank: the photos' pixels.
        use_masks: the photos have alpha that says what is object.
        background: what stands behind the object: 'white', 'black', 'random', 'environment' or
            'room'.
        keep_decoder: the feature basis, the heads and g stay as they are.
        fog: the density starts as one, so colours come first (see `FitSettings.emission_fade`).
    """

    OCCUPANCY_EVERY = 50

    def __init__(
        self, scene: Scene, bank: RayBank, settings: Settings, seed: int, use_masks: bool,
        background: str = "white", keep_decoder: bool = False, fog: bool = False,
    ):  # fmt: skip
        self.scene, self.bank, self.settings, self.seed = scene, bank, settings, seed
        self.use_masks, self.background = use_masks, background
        self.keep_decoder, self.fog = keep_decoder, fog
        self.exposures = exposures_for(settings.fit.exposure, bank.photo_count, scene.device)
        self.random = RandomNumbers(seed, scene.device)
        self.generator = torch.Generator().manual_seed(seed)
        fit = settings.fit
        if scene.device.type != "cpu":
            # A graphics card is busy only with many rays at once.
            fit = dataclasses.replace(fit, chunk_rays=fit.rays)
        self.batching = Batching(fit, settings.render.retraced_rays)
        self.step = 0
        self.level = 0
        self.steps_at_level = 0
        self.fraction_at_level = self.fraction = 0.0
        self.workers: Workers | None = None
        self._begin_level()

    def _begin_level(self) -> None:
        """New workers, optimiser and occupancy, for parameters that are new tensors."""
        if self.workers is not None:
            self.workers.close()
        self.optimiser = self._new_optimiser()
        count = worker_count(self.scene.device)
        if self.settings.fit.samples <= 0:
            count = min(count, len(self.batching.chunks()))
        self.workers = Workers(self.scene, count)
        self.steps_at_level = 0
        self.refresh_occupancy()

    def _new_optimiser(self) -> Adam:
        fit, scene = self.settings.fit, self.scene
        field = scene.field
        density = [field.density_planes, field.density_lines]
        features = [field.feature_planes, field.feature_lines]
        networks = [
            *field.basis.parameters(),
            *field.heads.parameters(),
            *scene.neural.parameters(),
        ]
        for parameter in networks:
            parameter.requires_grad_(not self.keep_decoder)
        groups = [
            {"params": density, "base": fit.learning_rate_grid, "smooth": None},
            {"params": features, "base": fit.learning_rate_grid},
            {"params": networks, "base": fit.learning_rate_network},
            {"params": [scene.environment.log_radiance], "base": fit.learning_rate_light},
        ]
        if scene.room is not None:
            groups[-1]["floor"] = fit.light_floor
            rates = fit.learning_rate_grid, fit.learning_rate_network
            groups += [
                {"params": params, "base": rate}
                for params, rate in zip(scene.room.parameter_groups(), rates, strict=True)
            ]
        return Adam(groups)

    def refresh_occupancy(self) -> None:
        """Bring the occupancy grid up to the current density."""
        field, least = self.scene.field, self.settings.field.occupancy_min_alpha
        if self.emission(self.fraction) == 1:
            least *= THIN_FOG_SHARE
        self.scene.occupancy.refresh(
            field, least, self.settings.render.step * field.voxel, dilation=1
        )

    def render_settings(self, fraction: float) -> RenderSettings:
        """Render settings at a fraction of the fit: g is blended out (see `FitSettings`)."""
        fit = self.settings.fit
        return dataclasses.replace(
            self.settings.render,
            neural=neural_share(fit, fraction),
            neighbour_distance=fit.neighbour_distance, emission=self.emission(fraction),
        )  # fmt: skip

    def emission(self, fraction: float) -> float:
        """Share of emission at a fraction of the fit."""
        return emission_share(self.settings.fit, fraction) if self.fog else 0.0

    def _learning_rate_factor(self, fraction: float) -> float:
        fit = self.settings.fit
        since = fraction - self.fraction_at_level if fit.restart_schedule else fraction
        decay = math.exp(since * math.log(fit.final_learning_rate))
        warm = min(self.steps_at_level / max(fit.warm_up, 1), 1)
        return decay * (0.1 + 0.9 * math.sin(0.5 * math.pi * warm))

    def advance(self, fraction: float) -> dict[str, float]:
        """One optimiser step at `fraction` in [0, 1) of the fit; returns what to report."""
        self.fraction = fraction
        self._coarse_to_fine(fraction)
        self.scene.field.smoothing = smoothing_width(self.settings.field, fraction)
        factor = self._learning_rate_factor(fraction)
        for group in self.optimiser.param_groups:
            group["lr"] = group["base"] * factor
        width = step_width(self.settings.field, fraction) * (self.scene.field.size - 1)
        self.optimiser.param_groups[0]["smooth"] = step_smoothing(width)
        if self.step % self.OCCUPANCY_EVERY == 0:
            self.refresh_occupancy()
        self.random.step = self.step
        chunks = self._draw(self.batching.chunks())
        total = sum(len(chunk.keys) for chunk in chunks)
        together = self.workers.together
        tables, carry_gradients = StepTables.of(self.scene, together).cut(len(self.workers.scenes))
        with gradients_in_place():
            found = self.workers.run(
                lambda worker, chunk: self._accumulate(
                    self.workers.scenes[worker], tables[worker], chunk, fraction, total
                ),
                chunks,
            )
            self.workers.gather_gradients()
            together(carry_gradients)
        together(self.optimiser.moves())
        if self.exposures is not None:
            self.exposures.step([taken.to_exposures for taken in found], factor)
        self.step += 1
        self.steps_at_level += 1
        image = 0.0
        for chunk, taken in zip(chunks, found, strict=True):
            self.batching.observe(len(chunk.keys), *taken.samples)
            image += taken.image * len(chunk.keys)
        return {
            "image": image / total, "psnr": -10 * math.log10(max(image / total, 1e-12)),
            "samples": sum(taken.samples[0] for taken in found), "rays": total,
        }  # fmt: skip

    def _draw(self, sizes: list[int]) -> list[Chunk]:
        """Random pixels for chunks of so many rays; all random numbers of a step are drawn here."""
        chunks, first, device = [], 0, self.scene.device
        for size in sizes:
            pixels = self.bank.draw(size, self.generator)
            colour = None
            if self.background == "random":
                colour = torch.rand(size, 3, generator=self.generator).to(device)
            chunks.append(Chunk(pixels, torch.arange(first, first + size, device=device), colour))
            first += size
        return chunks

    def _accumulate(
        self, scene: Scene, tables: StepTables, chunk: Chunk, fraction: float, total: int
    ) -> Taken:
        """Add a chunk's gradient to a worker's scene."""
        share = len(chunk.keys) / total
        batch = self.bank.batch(chunk.pixels)
        settings = dataclasses.replace(
            self.render_settings(fraction),
            retraced_rays=self.batching.retraced_of(share),
            diffuse_retraced_rays=round(self.settings.render.diffuse_retraced_rays * share),
        )
        buffers = render_rays(
            scene, tables, settings, self.random, batch.origins, batch.directions, chunk.keys,
            jitter=True, pixel_angle=batch.pixel_angle,
        )  # fmt: skip
        log_gain = None if self.exposures is None else self.exposures.cut()
        gain = None if log_gain is None else log_gain[batch.photo].exp()
        loss, terms = total_loss(
            buffers, batch, self.settings.fit, self.use_masks, fraction,
            self._behind(scene, batch, tables, chunk), gain,
        )  # fmt: skip
        if scene.room is not None:
            keys = chunk.keys[: max(1, round(ROOM_DIRECTIONS * share))]
            loss = loss + self.settings.fit.room_light_weight * room_light(
                scene, tables, self.random, keys
            )
        (loss * share).backward()
        samples = (buffers.samples, buffers.retraced, buffers.retraced_samples)
        return Taken(terms["image"], samples, None if log_gain is None else log_gain.grad)

    def _behind(self, scene: Scene, batch: RayBatch, tables: StepTables, chunk: Chunk) -> Behind:
        rays, device = len(batch.origins), batch.origins.device
        if self.background in SURROUNDED:
            u = self.random.uniform(ROOM_OFFSET, chunk.keys)
            rays_and_width = batch.origins, batch.directions, batch.pixel_angle
            return surroundings(scene, tables, *rays_and_width, u)
        if chunk.colour is not None:
            return chunk.colour
        return torch.full((rays, 3), 0.0 if self.background == "black" else 1.0).to(device)

    def _coarse_to_fine(self, fraction: float) -> None:
        starts = self.settings.field.size_starts
        level = max(i for i, start in enumerate(starts) if fraction >= start)
        if level == self.level:
            return
        self.level, self.fraction_at_level = level, fraction
        sizes, heights = self.settings.field.sizes, self.settings.light.heights
        self.scene.field.upsample(sizes[level])
        if self.scene.room is not None:
            self.scene.room.upsample(sizes[level])
        if level < len(heights):
            self.scene.environment = self.scene.environment.resized(heights[level])
        self.batching.restart()
        self._begin_level()
