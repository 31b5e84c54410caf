"""The optimisation loop's one step, and the state it carries."""

from __future__ import annotations

import dataclasses
import math

import torch

from ..render.radiance import render_rays
from ..render.random_numbers import SobolRotations
from ..render.scene import RenderSettings, Scene, StepTables
from .losses import total_loss
from .presets import Settings
from .ray_bank import RayBank


class Trainer:
    """Owns the scene's optimiser and its schedule over the fraction of the fit done.

    Args:
        scene: what is fitted, changed in place.
        bank: the photos' pixels.
        use_masks: the photos have alpha that says what is object.
        background: what stands behind the object in the photos: 'white' (also for photos with
            alpha, which are laid over white) or 'environment'.
    """

    OCCUPANCY_EVERY = 50

    def __init__(
        self, scene: Scene, bank: RayBank, settings: Settings, seed: int, use_masks: bool,
        background: str = "white",
    ):  # fmt: skip
        self.scene, self.bank, self.settings, self.seed = scene, bank, settings, seed
        self.use_masks, self.background = use_masks, background
        self.random = SobolRotations(seed, scene.field.centre.device)
        self.generator = torch.Generator().manual_seed(seed)
        self.step = 0
        self.level = 0
        self.steps_at_level = 0
        self.optimiser = self._new_optimiser()
        self.refresh_occupancy()

    def _new_optimiser(self) -> torch.optim.Adam:
        fit, scene = self.settings.fit, self.scene
        field = scene.field
        grids = [
            field.density_planes, field.density_lines, field.feature_planes, field.feature_lines
        ]  # fmt: skip
        networks = [
            *field.basis.parameters(),
            *field.heads.parameters(),
            *scene.neural.parameters(),
        ]
        groups = [
            {"params": grids, "base": fit.learning_rate_grid},
            {"params": networks, "base": fit.learning_rate_network},
            {"params": [scene.environment.log_radiance], "base": fit.learning_rate_light},
        ]
        self.steps_at_level = 0
        return torch.optim.Adam(groups, lr=1e-3, betas=(0.9, 0.99), eps=1e-15, fused=True)

    def refresh_occupancy(self) -> None:
        """Bring the occupancy grid up to the current density."""
        field, settings = self.scene.field, self.settings.field
        self.scene.occupancy.refresh(
            field, settings.occupancy_min_alpha, self.settings.render.step * field.voxel, dilation=1
        )

    def render_settings(self, fraction: float) -> RenderSettings:
        """Render settings at a fraction of the fit: g is blended out (see `FitSettings`)."""
        fit = self.settings.fit
        first, last = fit.neural_fade
        kept = 1 - min(max((fraction - first) / max(last - first, 1e-6), 0), 1)
        return dataclasses.replace(
            self.settings.render,
            neural=fit.neural_start * kept,
            neighbour_distance=fit.neighbour_distance,
        )

    def _learning_rate_factor(self, fraction: float) -> float:
        fit = self.settings.fit
        decay = math.exp(fraction * math.log(fit.final_learning_rate))
        warm = min(self.steps_at_level / max(fit.warm_up, 1), 1)
        return decay * (0.1 + 0.9 * math.sin(0.5 * math.pi * warm))

    def advance(self, fraction: float) -> dict[str, float]:
        """One optimiser step at `fraction` in [0, 1) of the fit; returns what to report."""
        self._coarse_to_fine(fraction)
        factor = self._learning_rate_factor(fraction)
        for group in self.optimiser.param_groups:
            group["lr"] = group["base"] * factor
        if self.step % self.OCCUPANCY_EVERY == 0:
            self.refresh_occupancy()
        batch = self.bank.batch(self.bank.draw(self.settings.fit.rays, self.generator))
        tables = StepTables.of(self.scene)
        buffers = render_rays(
            self.scene, tables, self.render_settings(fraction), self.random,
            batch.origins, batch.directions, jitter=True,
        )  # fmt: skip
        behind = None
        if self.background == "environment":
            pixel = batch.origins.new_full((len(batch.origins),), self.bank.pixel_solid_angle)
            behind = self.scene.environment.lookup(tables.light, batch.directions, pixel)
        loss, terms = total_loss(
            buffers, batch, self.settings.fit, self.use_masks, fraction, behind
        )
        self.optimiser.zero_grad(set_to_none=True)
        loss.backward()
        self.optimiser.step()
        self.step += 1
        self.steps_at_level += 1
        terms["psnr"] = -10 * math.log10(max(terms["image"], 1e-12))
        terms["samples"] = buffers.samples
        return terms

    def _coarse_to_fine(self, fraction: float) -> None:
        starts = self.settings.field.size_starts
        level = max(i for i, start in enumerate(starts) if fraction >= start)
        if level == self.level:
            return
        self.level = level
        sizes, heights = self.settings.field.sizes, self.settings.light.heights
        self.scene.field.upsample(sizes[level])
        if level < len(heights):
            self.scene.environment = self.scene.environment.resized(heights[level])
        self.optimiser = self._new_optimiser()
        self.refresh_occupancy()
