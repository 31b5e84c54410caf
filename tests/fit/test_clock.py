"""The fit's clock: work by grid size, time left, limits."""

import dataclasses

import pytest

from solver.fit import clock
from solver.fit.clock import LEAST_STEPS_FROM_FOG, FitClock, Renewals, work_done
from solver.fit.presets import DRAFT
from solver.fit.schedule import probe_turn


class Time:
    """A clock that tests set."""

    now = 100.0

    def monotonic(self):
        return self.now


@pytest.fixture
def time(monkeypatch):
    fake = Time()
    monkeypatch.setattr(clock, "time", fake)
    return fake


def test_work_grows_with_the_fraction_and_faster_on_finer_grids():
    done = [work_done(DRAFT, i / 20) for i in range(21)]
    gained = [b - a for a, b in zip(done, done[1:], strict=False)]
    assert done[0] == 0 and done[-1] == pytest.approx(1)
    assert all(b >= a - 1e-12 for a, b in zip(gained, gained[1:], strict=False))
    assert gained[-1] > 1.1 * gained[0]


def test_a_fog_takes_longer_while_it_shines():
    first, last = DRAFT.fit.emission_fade
    shining = work_done(DRAFT, first, fog=True) / work_done(DRAFT, first)
    rest = (1 - work_done(DRAFT, last, fog=True)) / (1 - work_done(DRAFT, last))
    assert shining / rest == pytest.approx(1.7, rel=1e-6)
    assert work_done(DRAFT, 1.0, fog=True) == pytest.approx(1)


def test_several_rays_a_pixel_take_longer_from_where_they_begin():
    fit = dataclasses.replace(DRAFT.fit, pixel_grid_start=0.7)
    render = dataclasses.replace(DRAFT.render, pixel_grid=2)
    finer = dataclasses.replace(DRAFT, fit=fit, render=render)
    one = dataclasses.replace(finer, render=dataclasses.replace(render, pixel_grid=1))
    before = work_done(finer, 0.7) / work_done(one, 0.7)
    after = (1 - work_done(finer, 0.7)) / (1 - work_done(one, 0.7))
    assert after / before == pytest.approx(1.54, rel=1e-6)
    assert work_done(finer, 1.0) == pytest.approx(1)


@pytest.mark.parametrize("fog", [False, True])
def test_time_left_is_right_when_steps_take_as_long_as_the_model_says(time, fog):
    watch = FitClock(DRAFT, 0.0, None, fog)
    for fraction in (0.1, 0.3, 0.7):
        step = round(fraction * DRAFT.fit.steps)
        time.now = 100.0 + 200.0 * work_done(DRAFT, step / DRAFT.fit.steps, fog)
        left = 200.0 * (1 - work_done(DRAFT, step / DRAFT.fit.steps, fog))
        assert watch.seconds_left(step) == pytest.approx(left, rel=0.01)


@pytest.mark.parametrize("begun", [0.0, 0.3])
def test_probes_that_are_renewed_more_often_early_do_not_make_time_left_longer(time, begun):
    """A fixed bug: by what they take in a draft's first tenth, almost half too much was told to be left."""
    steps, whole, each = DRAFT.fit.steps, 150.0, 0.8
    watch = FitClock(DRAFT, begun, None)
    first = round(begun * steps)
    ends, renewed, last = [100.0], [Renewals()], -1 if begun == 0 else probe_turn(begun)
    for step in range(first, steps):
        took = whole * (work_done(DRAFT, (step + 1) / steps) - work_done(DRAFT, step / steps))
        done, seconds = renewed[-1]
        if probe_turn(step / steps) != last:
            last = probe_turn(step / steps)
            done, seconds, took = done + 1, seconds + each, took + each
        ends.append(ends[-1] + took)
        renewed.append(Renewals(done, seconds))
    without = []
    for fraction in (0.1, 0.3, 0.5, 0.7, 0.9):
        told = round((begun + (1 - begun) * fraction) * steps)
        time.now = ends[told - first]
        left = ends[-1] - time.now
        assert watch.seconds_left(told, renewed[told - first]) == pytest.approx(left, rel=0.1)
        without.append(watch.seconds_left(told) / left)
    assert begun > 0 or without[0] > 1.2


def test_a_fits_first_step_does_not_count(time):
    watch = FitClock(DRAFT, 0.0, None)
    time.now += 5.0
    assert watch.seconds_left(1) is None
    start = time.now - 200.0 * work_done(DRAFT, 1 / DRAFT.fit.steps)
    for fraction in (0.1, 0.5):
        time.now = start + 200.0 * work_done(DRAFT, fraction)
        left = 200.0 * (1 - work_done(DRAFT, fraction))
        assert watch.seconds_left(round(fraction * DRAFT.fit.steps)) == pytest.approx(left, rel=0.01)


def test_on_a_card_all_steps_take_as_long_but_for_the_first(time):
    assert work_done(DRAFT, 0.3, on_card=True) == pytest.approx(0.3)
    assert work_done(DRAFT, 0.3) < 0.27
    watch = FitClock(DRAFT, 0.0, None, on_card=True)
    for step in range(1, DRAFT.fit.steps, 100):
        time.now = 103.0 + 0.01 * step
        left = watch.seconds_left(step)
        assert left is None or left == pytest.approx(0.01 * (DRAFT.fit.steps - step), rel=0.01)
    assert left is not None


def test_within_a_limit_time_decides_unless_the_steps_are_faster(time):
    watch = FitClock(DRAFT, 0.0, 60.0)
    time.now += 30
    assert watch.fraction(10) == pytest.approx(0.5)
    assert watch.seconds_left(10) <= 30
    assert watch.fraction(int(0.9 * DRAFT.fit.steps)) == pytest.approx(0.9)
    time.now += 30
    assert watch.fraction(10) == pytest.approx(1)


def test_a_resumed_fit_goes_on_where_it_was(time):
    watch = FitClock(DRAFT, 0.5, 60.0)
    assert watch.fraction(DRAFT.fit.steps // 2) == pytest.approx(0.5)
    time.now += 30
    assert watch.fraction(DRAFT.fit.steps // 2) == pytest.approx(0.75)


def test_a_fog_gets_the_steps_it_needs_to_become_an_object_however_short_the_limit(time):
    fog, hull = (FitClock(DRAFT, 0.0, 10.0, fog) for fog in (True, False))
    time.now += 10
    assert hull.fraction(50) == 1.0
    assert fog.fraction(50) == 50 / LEAST_STEPS_FROM_FOG and fog.fraction(LEAST_STEPS_FROM_FOG) == 1.0
    assert fog.seconds_left(50) == 0.0
