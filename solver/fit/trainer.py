"""The optimisation loop's one step, and the state it carries."""

from __future__ import annotations

import dataclasses
import math

import torch

from ..render.radiance import render_rays
from ..render.random_numbers import RandomNumbers
from ..render.scene import RenderSettings, Scene, StepTables
from .batching import Batching
from .losses import Behind, total_loss
from .presets import Settings, neural_share
from .ray_bank import RayBank, RayBatch


class Trainer:
    """Owns the scene's optimiser and its schedule over the fraction of the fit done.

    Args:
        scene: what is fitted, changed in place.
        bank: the photos' pixels.
        use_masks: the photos have alpha that says what is object.
        background: what stands behind the object: 'white', 'black', 'random' or 'environment'.
        keep_decoder: the feature basis, the heads and g stay as they are.
    """

    OCCUPANCY_EVERY = 50

    def __init__(
        self, scene: Scene, bank: RayBank, settings: Settings, seed: int, use_masks: bool,
        background: str = "white", keep_decoder: bool = False,
    ):  # fmt: skip
        self.scene, self.bank, self.settings, self.seed = scene, bank, settings, seed
        self.use_masks, self.background = use_masks, background
        self.keep_decoder = keep_decoder
        self.random = RandomNumbers(seed, scene.device)
        self.generator = torch.Generator().manual_seed(seed)
        self.batching = Batching(settings.fit, settings.render.retraced_rays)
        self.step = 0
        self.level = 0
        self.steps_at_level = 0
        self.fraction_at_level = 0.0
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
        for parameter in networks:
            parameter.requires_grad_(not self.keep_decoder)
        groups = [
            {"params": grids, "base": fit.learning_rate_grid},
            {"params": networks, "base": fit.learning_rate_network},
            {"params": [scene.environment.log_radiance], "base": fit.learning_rate_light},
        ]
        self.steps_at_level = 0
        fused = scene.device.type in ("cpu", "cuda")
        return torch.optim.Adam(groups, lr=1e-3, betas=(0.9, 0.99), eps=1e-15, fused=fused)

    def refresh_occupancy(self) -> None:
        """Bring the occupancy grid up to the current density."""
        field, settings = self.scene.field, self.settings.field
        self.scene.occupancy.refresh(
            field, settings.occupancy_min_alpha, self.settings.render.step * field.voxel, dilation=1
        )

    def render_settings(self, fraction: float) -> RenderSettings:
        """Render settings at a fraction of the fit: g is blended out (see `FitSettings`)."""
        fit = self.settings.fit
        return dataclasses.replace(
            self.settings.render,
            neural=neural_share(fit, fraction),
            neighbour_distance=fit.neighbour_distance,
            retraced_rays=self.batching.retraced,
        )

    def _learning_rate_factor(self, fraction: float) -> float:
        fit = self.settings.fit
        since = fraction - self.fraction_at_level if fit.restart_schedule else fraction
        decay = math.exp(since * math.log(fit.final_learning_rate))
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
        self.random.step = self.step
        chunks = self.batching.chunks()
        total = sum(chunks)
        self.optimiser.zero_grad(set_to_none=True)
        tables, carry_gradient = StepTables.of(self.scene).cut()
        report = {"image": 0.0, "samples": 0, "rays": total}
        first = 0
        for rays in chunks:
            batch = self.bank.batch(self.bank.draw(rays, self.generator))
            keys = torch.arange(first, first + rays, device=self.scene.device)
            terms = self._accumulate(tables, batch, keys, fraction, rays / total)
            report["image"] += terms["image"] * rays / total
            report["samples"] += terms["samples"]
            first += rays
        carry_gradient()
        self.optimiser.step()
        self.step += 1
        self.steps_at_level += 1
        report["psnr"] = -10 * math.log10(max(report["image"], 1e-12))
        return report

    def _accumulate(
        self,
        tables: StepTables,
        batch: RayBatch,
        keys: torch.Tensor,
        fraction: float,
        share: float,
    ) -> dict[str, float]:
        """Add the gradient of a chunk that is a `share` of the step's rays."""
        scene = self.scene
        buffers = render_rays(
            scene, tables, self.render_settings(fraction), self.random, batch.origins,
            batch.directions, keys, jitter=True,
        )  # fmt: skip
        loss, terms = total_loss(
            buffers, batch, self.settings.fit, self.use_masks, fraction,
            self._behind(batch, tables),
        )  # fmt: skip
        (loss * share).backward()
        self.batching.observe(
            len(keys), buffers.samples, buffers.retraced, buffers.retraced_samples
        )
        terms["samples"] = buffers.samples
        return terms

    def _behind(self, batch: RayBatch, tables: StepTables) -> Behind:
        rays, device = len(batch.origins), batch.origins.device
        if self.background == "environment":
            pixel = batch.origins.new_full((rays,), self.bank.pixel_solid_angle)
            light = self.scene.environment.lookup(tables.light, batch.directions, pixel)
            return Behind(light, is_linear=True)
        if self.background == "random":
            return Behind(torch.rand(rays, 3, generator=self.generator).to(device))
        return Behind(torch.full((rays, 3), 0.0 if self.background == "black" else 1.0).to(device))

    def _coarse_to_fine(self, fraction: float) -> None:
        starts = self.settings.field.size_starts
        level = max(i for i, start in enumerate(starts) if fraction >= start)
        if level == self.level:
            return
        self.level, self.fraction_at_level = level, fraction
        sizes, heights = self.settings.field.sizes, self.settings.light.heights
        self.scene.field.upsample(sizes[level])
        if level < len(heights):
            self.scene.environment = self.scene.environment.resized(heights[level])
        self.optimiser = self._new_optimiser()
        self.batching.restart()
        self.refresh_occupancy()
