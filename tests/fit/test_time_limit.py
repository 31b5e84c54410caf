"""What a time limit leaves for the fit, mesh, textures and report."""

import dataclasses
import math
import time
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from solver.fit import reconstruct
from solver.fit.batching import Batching
from solver.fit.checkpoint import read_state
from solver.fit.presets import DRAFT
from solver.fit.time_limit import (
    Finish,
    finish_within,
    limit_of_fit,
    seconds_from_fog,
    seconds_to_fit,
    too_few_steps,
)
from solver.job.control import Cancelled
from solver.job.folder import JobFolder
from solver.job.request import JobRequest
from tests.capture.test_capture import camera
from tests.cli.command import TINY
from tests.fit.test_standing import Heard
from tests.render.scenes import ball

LOOKUP = 2.5e-7


def limited(left, seconds, fog):
    """The fit's seconds, its share of rays and what was told, of a limit of 100 s."""
    heard = Heard()
    trainer = SimpleNamespace(fog=fog, batching=Batching(DRAFT.fit, 0))
    limit = limit_of_fit(100, left, Finish(512, 100, seconds, LOOKUP), trainer, heard)
    return limit, trainer.batching.share, heard.warnings


def test_a_limit_with_room_for_all_gives_the_fit_what_is_left_and_all_its_rays():
    assert limited(95, 10, False) == (85, 1.0, [])
    assert limited(95, 10, True) == (85, 1.0, [])


def test_a_fog_gets_by_with_fewer_rays_where_there_is_no_time_for_its_steps():
    assert seconds_from_fog(LOOKUP) == pytest.approx(50)
    assert limited(60, 20, True) == (40, pytest.approx(0.8), [])
    assert limited(60, 20, False) == (40, 1.0, [])
    limit, share, warnings = limited(10, 5, True)
    assert (limit, share) == (40, 0.8) and len(warnings) == 1


def test_what_will_take_longer_is_told_with_how_long():
    _, _, warnings = limited(30, 20, False)
    assert "1:40 is too short" in warnings[0] and "about 1:50" in warnings[0]
    assert len(limited(30, 20, True)[2]) == 1


def test_chunks_of_fewer_rays_are_as_many():
    batching = Batching(DRAFT.fit, 0)
    whole = batching.chunks()
    batching.share = 0.5
    assert len(batching.chunks()) == len(whole)
    assert sum(batching.chunks()) == sum(whole) // 2


def test_larger_textures_take_longer_to_finish():
    scene = ball()
    seconds = []
    for size in (64, 4096):
        asset = dataclasses.replace(DRAFT.asset, texture_size=size)
        settings = dataclasses.replace(DRAFT, asset=asset)
        seconds.append(finish_within(math.inf, scene, settings).seconds)
    assert 0 < seconds[0] < seconds[1]


def test_a_short_limit_makes_textures_and_the_reports_pictures_small_but_never_larger(monkeypatch):
    # Two measurements on a busy machine are not to be compared.
    monkeypatch.setattr("solver.fit.time_limit._seconds_of_a_lookup", lambda scene: LOOKUP)
    scene, cameras = ball(), [camera()] * 50
    free = finish_within(math.inf, scene, DRAFT, cameras)
    assert free.texture_size == DRAFT.asset.texture_size and free.what_is_less(DRAFT) is None
    assert finish_within(None, scene, DRAFT, cameras).what_is_less(DRAFT) is None
    ample = finish_within(100 * free.seconds, scene, DRAFT, cameras)
    assert ample.what_is_less(DRAFT) is None
    short = finish_within(1e-3, scene, DRAFT, cameras)
    assert short.texture_size == DRAFT.asset.texture_size // 2
    told = short.what_is_less(DRAFT)
    assert f"{short.texture_size} texels" in told and "report's pictures" in told
    assert short.seconds < 0.9 * free.seconds
    asset = dataclasses.replace(DRAFT.asset, texture_size=64)
    tiny = dataclasses.replace(DRAFT, asset=asset)
    least = finish_within(1e-3, scene, tiny, cameras)
    assert least.texture_size == 64 and "texels" not in least.what_is_less(tiny)


def test_photos_without_masks_take_longer_to_finish(monkeypatch):
    monkeypatch.setattr("solver.fit.time_limit._seconds_of_a_lookup", lambda scene: LOOKUP)
    scene, cameras = ball(), [camera()] * 50
    with_cameras = finish_within(math.inf, scene, DRAFT, cameras)
    assert with_cameras.seconds > 1.3 * finish_within(math.inf, scene, DRAFT).seconds


def test_a_limit_too_short_for_what_follows_still_leaves_the_fit_its_share():
    assert seconds_to_fit(300, 290, 20, False) == 270
    assert seconds_to_fit(60, 40, 90, False) == 0.2 * 60
    assert seconds_to_fit(60, 40, 90, True) == 0.4 * 60


def test_fits_of_few_steps_are_told_and_those_from_a_fog_earlier():
    assert too_few_steps(1000, 2800, fog=True) is None
    assert too_few_steps(200, 2800, fog=False) is None
    assert "200 of 2800 steps, too few for an object" in too_few_steps(200, 2800, fog=True)
    assert "100 of 2800 steps; for a better" in too_few_steps(100, 2800, fog=False)


def test_a_lookup_takes_time_whatever_the_coarsest_clock_says(monkeypatch):
    """That of Windows stands still while a fast card looks up all that is tried."""
    monkeypatch.setattr(time, "monotonic", lambda: 1000.0)
    finish = finish_within(math.inf, ball(), DRAFT)
    assert finish.lookup > 0 and seconds_from_fog(finish.lookup) > 0


def test_a_limit_counts_what_a_job_took_each_time_it_was_run_start_up_included(duck, tmp_path, monkeypatch):
    """A fixed bug: of runs that were stopped only the fit's seconds were known to those that went on."""
    overrides = dict(text.split("=") for text in [*TINY[1::2], "fit.steps=9000"])
    request = JobRequest(str(duck), overrides=overrides, time_limit=1000)
    job = JobFolder.create(tmp_path / "job", request)
    left = []

    def told(whole, seconds, *_):
        left.append(seconds)
        return 600.0

    monkeypatch.setattr(reconstruct, "limit_of_fit", told)

    def stopped(stage, began_before):
        """Run the job until this stage; it was asked for so many seconds ago."""
        progress, control = Mock(), SimpleNamespace(should_stop=False)

        def begun(name, *_):
            control.should_stop = name == stage

        progress.stage.side_effect = begun
        asked = time.monotonic() - began_before
        with pytest.raises(Cancelled):
            reconstruct.run_job(job, progress, control, asked)
        return time.monotonic() - asked

    took = 0.0
    for stage, start_up in (("fit", 100), ("geometry", 30), ("fit", 200)):
        took += stopped(stage, start_up)
        assert read_state(job.checkpoint_dir)["seconds"] == pytest.approx(took, abs=1.0)
    assert left[0] < 900 and left[1] < 1000 - 100 - 30 - 200
