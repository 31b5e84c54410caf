"""How much of a fit is done, and when it will be over, by steps or within a time limit."""

import time
from itertools import pairwise
from typing import NamedTuple

from .schedule import PROBE_TURNS, emission_share, pixel_grid, probe_turn
from .settings import Settings

# A step costs about as much as 1 + (G/194)² on a grid of G nodes per axis: rays, and passes over
# the whole grid (measured, 64 to 160 nodes).
_GRID_AT_EQUAL_COST = 194.0
# A fog is seen at all its samples, so while points shine by themselves a step costs more (measured).
_FOG_COST = 1.7
# What each further ray through a pixel adds to a step's cost, its secondary rays being shared (measured).
_RAY_COST = 0.18
LEAST_STEPS_FROM_FOG = 200
"""steps, however short a limit is: with 120 the fog of a whole fit stayed thin, and there was no surface"""


class Renewals(NamedTuple):
    """What probes and the light's detail took, which are renewed far more often early in a fit."""

    done: int = 0
    seconds: float = 0.0


NO_RENEWALS = Renewals()


def work_done(settings: Settings, fraction: float, fog: bool = False, on_card: bool = False) -> float:
    """Share of all steps' time that a fit's first `fraction` takes: those on coarse grids are faster.

    Args:
        fog: it starts as one (see `Trainer`).
        on_card: on one that replays steps, which takes as long on coarse grids and for few rays (measured
            on an H200).
    """
    fade = settings.fit.emission_fade if fog else (0.0, 0.0)
    finer = min(settings.fit.pixel_grid_start, 1.0)
    edges = sorted({*settings.field.size_starts, *fade, finer, 1.0})

    def cost(at: float) -> float:
        level = sum(start <= at for start in settings.field.size_starts) - 1
        shining = emission_share(settings.fit, at) if fog else 0.0
        grid, further = grid_cost(settings.field.sizes[level]), pixel_grid(settings, at) ** 2 - 1
        if on_card:
            grid, further = 1.0, 0
        return grid * (1 + (_FOG_COST - 1) * shining) * (1 + _RAY_COST * further)

    spans = [(start, end, cost((start + end) / 2)) for start, end in pairwise(edges)]
    whole = sum((end - start) * cost for start, end, cost in spans)
    return sum(max(min(end, fraction) - start, 0) * cost for start, end, cost in spans) / whole


def grid_cost(size: int) -> float:
    """What a step takes on a grid of `size` nodes per axis, in times of one on a grid of none."""
    return 1 + (size / _GRID_AT_EQUAL_COST) ** 2


class FitClock:
    """Tells how much of a fit is done, and when it will be over.

    Args:
        begun: fraction of the fit that was done before (a resumed fit).
        limit: seconds of wall time for the rest, or None to count steps.
        fog: the fit started as one. on_card: see `work_done`.
    """

    PATIENCE = 2.0  # seconds before an estimate means anything

    def __init__(
        self, settings: Settings, begun: float, limit: float | None, fog: bool = False,
        on_card: bool = False,
    ):  # fmt: skip
        self.settings, self.begun, self.limit, self.fog = settings, begun, limit, fog
        self.on_card = on_card
        self.started = time.monotonic()
        self._first: tuple[float, float, Renewals] | None = None

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

    def seconds_left(self, step: int, renewed: Renewals = NO_RENEWALS) -> float | None:
        """Seconds until the fit is over; None while nobody can tell. To be asked after every step.

        Args:
            renewed: since the start; what that takes is no part of a step.
        """
        elapsed, fraction = self.elapsed, self.fraction(step)
        work = self._work(fraction)
        if self._first is None:
            # The first step takes longer than others: on a card seconds, also where a fit goes on.
            begun = 0.0, self._work(self.begun), NO_RENEWALS
            self._first = (elapsed, work, renewed) if self.on_card or step == 1 else begun
        first, work_before, before = self._first
        since, share = elapsed - first, work - work_before
        if since < self.PATIENCE or share <= 0:
            return None
        renewing = renewed.seconds - before.seconds
        by_work = (since - renewing) / max(share, 1e-3) * (1 - work)
        if renewed.done > before.done:
            left = PROBE_TURNS - 1 - probe_turn(fraction)
            by_work += max(left, 0) * renewing / (renewed.done - before.done)
        return by_work if self.limit is None else min(by_work, max(self.limit - elapsed, 0.0))

    def _work(self, fraction: float) -> float:
        return work_done(self.settings, fraction, self.fog, self.on_card)
