"""The optimisation loop's one step, and the state it carries."""

import dataclasses
import math
import time
from contextlib import nullcontext

import torch

from ..field.smoothing import step_smoothing
from ..light.environment import EnvironmentMap
from ..light.smoothing import map_smoothing
from ..render.probing import refresh_probes
from ..render.random_numbers import RandomNumbers
from ..render.scene import Scene
from .adam import Adam
from .batching import Batching, room_on
from .chunk import SURROUNDED, ChunkLoss, Taken
from .clock import NO_RENEWALS, Renewals
from .doubtful_outlines import DoubtfulOutlines
from .exposure import exposures_for
from .far_light import FarLight
from .light_colours import colour_coarsely
from .light_detail import OpenDetail
from .light_start import light_from_room
from .ray_bank import RayBank
from .replay import replay_for
from .schedule import (
    light_step_width,
    pixel_grid,
    probe_turn,
    smoothing_width,
    steepness,
    step_width,
)
from .settings import Settings
from .step import Drawn, Step, StepPixels, StepPlan, add_gradients

DENSITY, LIGHT = 0, 3
"""their groups of parameters"""
THIN_FOG_SHARE = 0.02
"""of the opacity from which a cell counts as occupied, while the fog is thin still"""
STEPS_OF_PIXELS = 4
"""as many pixels as steps have tell, at the end, how fine the colours of the light have to be"""
TURNS_A_STEP = 4
"""photos of which a step has pixels, at least, where the light turned with them; each has its own tables"""
STEEPENED_ABOUT = 0.1
"""optical depth of a voxel that stays: about that of an outline, where rays are long within the surface"""
HELD = 0.02
"""of the fit, for which what steps do may stay the same where they are replayed"""


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
        opened: [K, K, K] bool over the box, where something may be once points shine less by themselves;
            None: where it may be at the start.
        turns: [photos, 3, 3] by which the light was turned for each photo (see `Turntable.turn_of`); None:
            it stood still.
        far: the light that photos themselves show, held to it (see `FarLight`); None: they show none.
    """

    OCCUPANCY_EVERY = 50

    def __init__(
        self, scene: Scene, bank: RayBank, settings: Settings, seed: int, use_masks: bool,
        background: str = "white", keep_decoder: bool = False, fog: bool = False,
        opened: torch.Tensor | None = None, turns: torch.Tensor | None = None,
        far: FarLight | None = None,
    ):  # fmt: skip
        self.scene, self.bank, self.settings, self.seed = scene, bank, settings, seed
        self.use_masks, self.background = use_masks, background
        self.keep_decoder, self.fog, self.opened, self.turns = keep_decoder, fog, opened, turns
        self.far = far
        self.outlines = DoubtfulOutlines(bank)
        self.exposures = exposures_for(settings.fit.exposure, bank.photo_count, scene.device)
        self.random = RandomNumbers(seed, scene.device)
        self.loss = ChunkLoss(settings, use_masks, background, fog, far)
        self.generator = torch.Generator().manual_seed(seed)
        self.pixels = StepPixels(bank, background, turns, self.generator)
        fit = settings.fit
        if scene.device.type != "cpu":
            # A graphics card is busy only with many rays at once.
            fit = dataclasses.replace(fit, rays_at_once=fit.rays * settings.render.pixel_grid**2)
        # A chunk has one light: under turned ones a step must not be one.
        room, least = (room_on(scene.device), 1) if turns is None else (1, TURNS_A_STEP)
        self.batching = Batching(fit, settings.render.retraced_rays, room, least)
        self.step = 0
        self.level = 0
        self.steps_at_level = 0
        self.fraction_at_level = self.fraction = 0.0
        self.probe_turn, self.renewed = -1, NO_RENEWALS
        self.open_detail = OpenDetail(settings.light)
        # The tables of a light that turns are others in each step.
        self.replay = replay_for(scene.device) if turns is None else None
        self._begin_level()

    def _begin_level(self) -> None:
        """A new optimiser and occupancy, for parameters that are new tensors."""
        self.optimiser = self._new_optimiser()
        self.steps_at_level = 0
        if self.replay is not None:
            self.replay.release()
        self.refresh_occupancy()

    def begin_light(self, found: EnvironmentMap) -> None:
        """Let the light begin anew as what was `found`, of its size."""
        environment = self.scene.environment
        with torch.no_grad():
            environment.log_radiance.copy_(found.log_radiance)
        self.optimiser.forget(environment.log_radiance)

    def _new_optimiser(self) -> Adam:
        fit, scene = self.settings.fit, self.scene
        field = scene.field
        density = [field.density_planes, field.density_lines]
        features = [field.feature_planes, field.feature_lines]
        networks = [*field.basis.parameters(), *field.heads.parameters(), *scene.neural.parameters()]
        for parameter in networks:
            parameter.requires_grad_(not self.keep_decoder)
        groups = [
            {"params": density, "base": fit.learning_rate_grid, "smooth": None},
            {"params": features, "base": fit.learning_rate_grid},
            {"params": networks, "base": fit.learning_rate_network},
            {
                "params": [scene.environment.log_radiance],
                "base": fit.learning_rate_light,
                "floor": fit.light_floor_without_room if scene.room is None else fit.light_floor,
            },
        ]
        if scene.room is not None:
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
        self.scene.occupancy.refresh(field, least, self.settings.render.step * field.voxel, dilation=1)
        self._end_period()

    def _end_period(self) -> None:
        """What steps read lies elsewhere from now on."""
        if self.replay is not None:
            self.replay.forget()

    def refresh_probes(self) -> None:
        """Let diffuse light be blocked by the surface as the occupancy grid has it, unless it is not to
        be, or everything still shines by itself."""
        if self.settings.render.diffuse_visibility and self.emission(self.fraction) < 1:
            refresh_probes(self.scene)
            self._end_period()

    def emission(self, fraction: float) -> float:
        """Share of emission at a fraction of the fit."""
        return self.loss.emission(fraction)

    @torch.no_grad()
    def finish(self) -> None:
        """What is left to do when the last step is done."""
        # Graphs keep memory that is needed elsewhere now.
        self.replay = None
        self.refresh_occupancy()
        self.refresh_probes()
        tolerance = self.settings.light.colour_tolerance
        if tolerance > 0 and not self._light_is_shown:
            pixels = self.some_pixels(STEPS_OF_PIXELS)
            colour_coarsely(self.scene, self.loss, pixels, tolerance)
            self.refresh_probes()

    def _learning_rate_factor(self, fraction: float) -> float:
        fit = self.settings.fit
        since = fraction - self.fraction_at_level if fit.restart_schedule else fraction
        decay = math.exp(since * math.log(fit.final_learning_rate))
        warm = min(self.steps_at_level / max(fit.warm_up, 1), 1)
        return decay * (0.1 + 0.9 * math.sin(0.5 * math.pi * warm))

    def advance(self, fraction: float) -> dict[str, float]:
        """One optimiser step at `fraction` in [0, 1) of the fit; returns what to report.

        Where steps are replayed, what is said of the image is of the step before, for which nothing waits.
        """
        with nullcontext() if self.replay is None else self.replay.stream():
            return self._advance(fraction)

    def _advance(self, fraction: float) -> dict[str, float]:
        begin_to_reflect = self.emission(self.fraction) == 1 > self.emission(fraction)
        self.fraction = fraction
        self._coarse_to_fine(fraction)
        if begin_to_reflect:
            self._end_period()
        if begin_to_reflect and self.scene.room is not None and self.settings.light.from_room:
            height = self.scene.environment.height
            self.begin_light(light_from_room(self.scene.room, height))
        factor = self._learning_rate_factor(fraction)
        for group in self.optimiser.param_groups:
            group["lr"] = group["base"] * factor
        width = step_width(self.settings.field, fraction) * (self.scene.field.size - 1)
        self.optimiser.param_groups[DENSITY]["smooth"] = step_smoothing(width)
        height = self.scene.environment.height
        width = light_step_width(self.settings.light, height, fraction)
        self.optimiser.param_groups[LIGHT]["smooth"] = map_smoothing(width)
        if self.opened is not None and self.emission(fraction) < 1:
            self.scene.occupancy.allow_only(self.opened, 0)
            self.opened = None
            self.refresh_occupancy()
        if self.step % self.OCCUPANCY_EVERY == 0:
            self._steepen(fraction)
            self.refresh_occupancy()
        if probe_turn(fraction) != self.probe_turn:
            self._renew(fraction)
        plan = self._begin_period(pixel_grid(self.settings, fraction))
        self.scene.field.smoothing = smoothing_width(self.settings.field, plan.fraction)
        found, counted = self._gradients(plan)
        self.optimiser.step()
        rate = self.optimiser.param_groups[LIGHT]["lr"]
        self.open_detail.take_away(self.scene.environment, self.step, rate)
        if self.exposures is not None:
            self.exposures.step([taken.to_exposures for taken in found], factor)
        self.step += 1
        self.steps_at_level += 1
        if counted:
            for rays, taken in zip(plan.rays, found, strict=True):
                self.batching.observe(rays, *taken.samples)
        image = sum(taken.image * share for taken, share in zip(found, plan.shares, strict=True))
        image = float(image) if self.replay is None else self.replay.told_before(image)
        return {"image": image, "rays": sum(plan.rays)}

    def _steepen(self, fraction: float) -> None:
        field = self.scene.field
        factor = steepness(self.settings.field, fraction) / field.steepness
        if factor > 1 and not self.fog:
            field.steepen(factor, STEEPENED_ABOUT / field.voxel)

    def _renew(self, fraction: float) -> None:
        began = time.monotonic()
        self.probe_turn = probe_turn(fraction)
        self.refresh_probes()
        self.outlines.look(self.scene, self.loss.render_settings(fraction), fraction)
        if self.open_detail.wanted(fraction) and not self._light_is_shown:
            pixels = self.some_pixels(self.open_detail.STEPS)
            self.open_detail.look(self.scene, self.loss, pixels)
        done, seconds = self.renewed
        self.renewed = Renewals(done + 1, seconds + time.monotonic() - began)

    @property
    def _light_is_shown(self) -> bool:
        """Photos show the light itself, and then it is as fine as they are."""
        return self.far is not None or self.background in SURROUNDED

    def some_pixels(self, steps: int) -> list[Step]:
        """Chunks of random pixels, as many as steps have, all with the same random numbers."""
        # Each step under turned lights has tables of them all.
        steps = steps if self.turns is None else 1
        plan = self._plan(pixel_grid(self.settings, self.fraction))
        random, log_gain = self.random.at(self.step), self.log_gain
        drawn = [self.pixels.draw(plan.sizes) for _ in range(steps)]
        return [(self.pixels.chunks(plan, some, random, log_gain), some.turns) for some in drawn]

    def _begin_period(self, grid: int) -> StepPlan:
        """The plan of a step: one of its own, or that of all steps that are replayed."""
        if self.replay is None:
            return self._plan(grid)
        plan = self.replay.plan
        if (
            plan is None or plan.grid != grid or self.fraction - plan.fraction > HELD
            or not self.batching.settled
        ):  # fmt: skip
            self.replay.begin(self._plan(grid))
        return self.replay.plan

    def _plan(self, grid: int) -> StepPlan:
        sizes = self.batching.chunks(grid * grid)
        retraced = [self.batching.retraced_of(size / sum(sizes), size * grid * grid) for size in sizes]
        return StepPlan(sizes, grid, retraced, self.fraction)

    def _gradients(self, plan: StepPlan) -> tuple[list[Taken], bool]:
        """Add a step's gradients to those of the scene; returns what chunks found, and whether their counts
        are those of the step."""
        drawn = self.pixels.draw(plan.sizes)
        log_gain = self.log_gain
        if self.replay is None:
            chunks = self.pixels.chunks(plan, drawn, self.random.at(self.step), log_gain)
            return add_gradients(self.scene, self.loss, chunks, drawn.turns), True

        def compute(pixels, colours, streams):
            # A light that turns is not replayed.
            again, random = Drawn(pixels, colours, (None,)), self.random.of(streams)
            chunks = self.pixels.chunks(plan, again, random, log_gain)
            return add_gradients(self.scene, self.loss, chunks)

        streams = self.random.streams_at(self.step)
        return self.replay.run(compute, self.optimiser.clear, drawn.pixels, drawn.colours, streams)

    @property
    def log_gain(self) -> torch.Tensor | None:
        """[photos, C] of the photos' exposures, where those are found."""
        return None if self.exposures is None else self.exposures.log_gain.detach()

    def _coarse_to_fine(self, fraction: float) -> None:
        starts = self.settings.field.size_starts
        level = max(i for i, start in enumerate(starts) if fraction >= start)
        if level <= self.level:
            return
        self.level, self.fraction_at_level = level, fraction
        sizes, heights = self.settings.field.sizes, self.settings.light.heights
        self.scene.field.upsample(sizes[level])
        if self.scene.room is not None:
            self.scene.room.upsample(sizes[level])
        height = heights[min(level, len(heights) - 1)]
        if height != self.scene.environment.height:
            self.scene.environment = self.scene.environment.resized(height)
            # A table's gloss is another in each photo; of what is far all show the same.
            if self.far is not None and self.scene.environment.floor is None:
                self.far.put_into(self.scene.environment)
        self.batching.restart()
        self._begin_level()
