"""A table as light from close by, on its way from photos to a fit and a checkpoint."""

import dataclasses

import numpy as np
import pytest

from solver.capture.frames import texel_directions
from solver.capture.panorama import Panorama
from solver.fit import checkpoint
from solver.fit.far_light import NOTHING_SEEN, SeenLight
from solver.fit.isolation import Isolated, isolated
from solver.fit.load import load_light
from solver.fit.presets import PAPER
from solver.fit.start import new_trainer
from solver.job.folder import JobFolder
from solver.job.request import JobRequest
from solver.light.floor import Floor
from tests.fit import table_scene as things
from tests.fit.table_scene import CENTRE, RADIUS, table_scene
from tests.fit.test_fit import SMALL, ball_capture
from tests.fit.test_standing import SETTINGS, Heard

FLOOR = Floor((0.0, 0.0, 1.0), -0.5, (0.0, 0.1, 0.2))


@pytest.fixture(scope="module")
def started(tmp_path_factory):
    """What a fit of a red ball on a table begins with."""
    capture, photos, _ = table_scene(things.ball, things.red)
    job = JobFolder.create(tmp_path_factory.mktemp("floor") / "job", JobRequest(capture="/nowhere"))
    far = dataclasses.replace(SETTINGS.light, floor=False)
    first = isolated(job, SETTINGS, capture, photos, False, Heard(), lambda done: None)
    without = isolated(
        job, dataclasses.replace(SETTINGS, light=far), capture, photos, False, Heard(), lambda done: None
    )
    return first, without


def test_the_floor_is_the_table_seen_from_the_middle_of_what_stands_there(started):
    floor = started[0].light.floor
    np.testing.assert_allclose(floor.up, [0, 0, 1], atol=0.01)
    assert abs(floor.height) < 0.01
    np.testing.assert_allclose(floor.centre, CENTRE, atol=0.2 * RADIUS)
    assert started[1].light.floor is None and not PAPER.light.floor


def test_the_first_light_has_the_table_where_it_is(started):
    """As traced from the floor's centre, but for its gloss; taken as far away, its grain is lost."""
    likeness = []
    for start in started:
        light = start.light.first
        directions = texel_directions(light.height, 2 * light.height)[light.known]
        low = directions[:, 2] < -0.4
        centre = np.array(started[0].light.floor.centre)
        true = things._around(np.broadcast_to(centre, directions[low].shape), directions[low])
        likeness.append(np.corrcoef(light.colour[light.known][low, 0], true[:, 0])[0, 1])
    assert likeness[0] > 0.65 and likeness[1] < 0.4, likeness


def test_the_light_is_held_to_the_floor_that_photos_show_and_to_nothing_else(started):
    first, without = started
    held = first.light.held
    rows = np.flatnonzero(held.known.all(1))
    assert rows.min() in range(held.height // 2, held.height // 2 + 12)
    assert rows.max() == held.height - 1 and not held.known[: held.height // 2].any()
    # What the ball stands on no photo shows; there it is as beside it.
    assert not first.light.first.known[-1].any() and held.colour[-1].min() > 0.1
    assert without.light.held is None


def test_a_fit_that_goes_on_is_held_to_the_same(tmp_path):
    capture, photos, _ = table_scene(things.ball, things.red, views=14)
    job = JobFolder.create(tmp_path / "job", JobRequest(capture="/nowhere"))
    began, again = (
        isolated(job, SETTINGS, capture, photos, resumed, Heard(), lambda done: None)
        for resumed in (False, True)
    )
    np.testing.assert_array_equal(again.light.held.colour, began.light.held.colour)
    old = dataclasses.replace(SETTINGS, light=dataclasses.replace(SETTINGS.light, floor=False))
    then = isolated(job, old, capture, photos, True, Heard(), lambda done: None)
    assert then.light == NOTHING_SEEN


def trainer_on(floor, **how):
    capture, photos = ball_capture()
    return new_trainer(
        capture, photos, SMALL, 0, None, "cpu", lambda done: None, SeenLight(floor=floor, **how)
    )


def test_a_fit_lights_its_object_by_the_floor_at_every_resolution_of_the_light():
    trainer = trainer_on(FLOOR)
    assert trainer.scene.environment.floor == FLOOR
    height = trainer.scene.environment.height
    trainer.advance(0.0)
    trainer.advance(0.6)
    assert trainer.scene.environment.height > height
    assert trainer.scene.environment.floor == FLOOR
    assert trainer_on(None).scene.environment.floor is None and Isolated(None, []).light == NOTHING_SEEN


def test_the_light_on_the_floor_stays_with_what_photos_show_but_is_not_overwritten():
    known = np.zeros((256, 512), bool)
    known[160:] = True
    red = known[..., None] * np.float32([0.8, 0.2, 0.2])
    shown = Panorama(red, known)
    free, held, far = (
        trainer_on(floor, held=panorama, first=Panorama(red * 0 + 0.5, known | True))
        for floor, panorama in ((FLOOR, None), (FLOOR, shown), (None, shown))
    )
    for trainer in (free, held, far):
        for step in range(6):
            trainer.advance(0.1 * (step + 1))
    lights = [t.scene.environment.log_radiance.detach() for t in (free, held, far)]
    tint = [float((light[0] - light[1])[-8:].mean()) for light in lights]
    assert tint[1] > 3 * abs(tint[0]) and 2 < tint[2] > 3 * tint[1]


def test_a_checkpoint_keeps_the_floor_and_as_another_objects_light_it_is_far(tmp_path):
    trainer = trainer_on(FLOOR)
    job = JobFolder.create(tmp_path / "job", JobRequest(capture="/nowhere"))
    checkpoint.save_checkpoint(trainer, job.checkpoint_dir, 1.0, done=True)
    scene, _, _ = checkpoint.load_scene(job.checkpoint_dir)
    assert scene.environment.floor == FLOOR
    assert load_light(job.root, scene.device).floor is None
