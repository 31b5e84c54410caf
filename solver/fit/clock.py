"""How long a fit and what follows it will take; the fit's clock within a time limit."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from itertools import pairwise

import torch

from ..capture.camera import Camera
from ..render.scene import Scene
from .report import MOST_PIXELS, VIEWS
from .schedule import emission_share, pixel_grid
from .settings import Settings

# A step costs about as much as 1 + (G/194)² on a grid of G nodes per axis: rays, and passes over
# the whole grid (measured, 64 to 160 nodes).
_GRID_AT_EQUAL_COST = 194.0
# A fog is seen at all its samples, so while points shine by themselves a step costs more (measured).
_FOG_COST = 1.7
# What each further ray through a pixel adds to a step's cost, its secondary rays being shared (measured).
_RAY_COST = 0.45
# Mesh, textures and report take as long as this many lookups of the surface a texel, and that many
# for what does not depend on the textures (measured: 18 s where a lookup takes 0.29 µs).
_LOOKUPS_PER_TEXEL = 30.0
_OTHER_LOOKUPS = 30_000_000
# Without masks each pixel of the report shows something, and the surface is looked at from all photos
# (measured on *fox*: 40 to 60 s with the rest, the more the longer the fit was).
_LOOKUPS_PER_SHOWN_PIXEL, _LOOKUPS_PER_PHOTO = 800, 1_100_000
# A light of which a floor is close by is looked up for its far twin (measured, 6 s).
_LOOKUPS_OF_FLOOR = 20_000_000
_TRIAL = 30_000
LEAST_FIT, LEAST_FIT_FROM_FOG = 0.2, 0.4
"""share of a time limit that is the fit's at least"""
LEAST_STEPS_FROM_FOG = 200
"""steps, however short a limit is: with 120 the fog of a whole fit stayed thin, and there was no surface"""


def work_done(settings: Settings, fraction: float, fog: bool = False) -> float:
    """Share of a fit's time that its first `fraction` takes: steps on coarse grids are faster.

    Args:
        fog: it starts as one (see `Trainer`).
    """
    fade = settings.fit.emission_fade if fog else (0.0, 0.0)
    finer = min(settings.fit.pixel_grid_start, 1.0)
    edges = sorted({*settings.field.size_starts, *fade, finer, 1.0})

    def cost(at: float) -> float:
        level = sum(start <= at for start in settings.field.size_starts) - 1
        grid = grid_cost(settings.field.sizes[level])
        shining = emission_share(settings.fit, at) if fog else 0.0
        further = pixel_grid(settings, at) ** 2 - 1
        return grid * (1 + (_FOG_COST - 1) * shining) * (1 + _RAY_COST * further)

    spans = [(start, end, cost((start + end) / 2)) for start, end in pairwise(edges)]
    whole = sum((end - start) * cost for start, end, cost in spans)
    return sum(max(min(end, fraction) - start, 0) * cost for start, end, cost in spans) / whole


def grid_cost(size: int) -> float:
    """What a step takes on a grid of `size` nodes per axis, in times of one on a grid of none."""
    return 1 + (size / _GRID_AT_EQUAL_COST) ** 2


def finishing_seconds(scene: Scene, settings: Settings, cameras: Sequence[Camera] = ()) -> float:
    """Estimate of the seconds that mesh, textures and report will take, by a trial of lookups.

    Args:
        cameras: of the photos, where these have no masks.
    """
    generator = torch.Generator().manual_seed(0)
    points = torch.rand(_TRIAL, 3, generator=generator).to(scene.device) * 2 - 1
    points = scene.field.centre + scene.field.half_size * points
    best = math.inf
    with torch.no_grad():
        factors = scene.normal_tables()
        for _ in range(3):
            started = time.monotonic()
            float(scene.surface(points, None, factors).normals.sum())
            best = min(best, time.monotonic() - started)
    lookups = _LOOKUPS_PER_TEXEL * settings.asset.texture_size**2 + _OTHER_LOOKUPS
    shown = sum(min(c.width * c.height, MOST_PIXELS) for c in cameras[:VIEWS])
    lookups += _LOOKUPS_PER_SHOWN_PIXEL * shown + _LOOKUPS_PER_PHOTO * len(cameras)
    if scene.environment.floor is not None:
        lookups += _LOOKUPS_OF_FLOOR
    return lookups * best / _TRIAL


def seconds_to_fit(limit: float, left: float, finishing: float, fog: bool) -> float:
    """Seconds of a job's time limit that go to the fit.

    What follows it cannot be shortened, so a limit may be too short for both. Then it is not kept, rather
    than that nothing comes of it: there is a least share for the fit, the more where a fog must become
    an object first.

    Args:
        limit: seconds for all. left: of those. finishing: what follows is estimated to take.
        fog: the fit starts as one.
    """
    return max(left - finishing, (LEAST_FIT_FROM_FOG if fog else LEAST_FIT) * limit)


class FitClock:
    """Tells how much of a fit is done, and when it will be over.

    Args:
        begun: fraction of the fit that was done before (a resumed fit).
        limit: seconds of wall time for the rest, or None to count steps.
        fog: the fit started as one.
    """

    PATIENCE = 2.0  # seconds before an estimate means anything

    def __init__(self, settings: Settings, begun: float, limit: float | None, fog: bool = False):
        self.settings, self.begun, self.limit, self.fog = settings, begun, limit, fog
        self.started = time.monotonic()

    @property
    def elapsed(self) -> float:
        """Seconds since the start."""
        return time.monotonic() - self.started

    def fraction(self, step: int) -> float:
        """Fraction of the fit done after `step` steps: by the steps, or by a limit that is nearer."""
        done = max(step / self.settings.fit.steps, self.begun)
        if self.limit is None:
            return done
        by_time = self.begun + (1 - self.begun) * self.elapsed / self.limit
        if self.fog:
            by_time = min(by_time, step / LEAST_STEPS_FROM_FOG)
        return max(done, by_time)

    def seconds_left(self, step: int) -> float | None:
        """Seconds until the fit is over; None while nobody can tell."""
        elapsed, done = self.elapsed, self.fraction(step)
        if elapsed < self.PATIENCE or done <= self.begun:
            return None
        before = work_done(self.settings, self.begun, self.fog)
        share = work_done(self.settings, done, self.fog) - before
        by_work = elapsed / max(share, 1e-3) * (1 - before - share)
        return by_work if self.limit is None else min(by_work, max(self.limit - elapsed, 0.0))
