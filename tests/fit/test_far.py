"""Georeferenced captures: millions of units from the origin, where single precision has half a unit."""

import dataclasses

import numpy as np
import pytest

from solver.capture.placement import far_origin, placed, seen_from
from solver.fit.load import render_cameras
from solver.fit.start import new_trainer
from tests.fit.test_fit import SMALL, ball_capture, resumed

PLACE = np.array([4.0e5, 5.2e6, 120.0])
STEPS = 6


@pytest.fixture(scope="module")
def near_and_far():
    """Two fits of the same photos, one with its cameras far away."""
    capture, photos = ball_capture()
    fits = []
    for place in (np.zeros(3), PLACE):
        moved = seen_from(capture, -place)
        trainer = new_trainer(moved, photos, SMALL, 0, None, "cpu", lambda fraction: None)
        losses = [trainer.advance(i / STEPS)["image"] for i in range(STEPS)]
        fits.append((trainer, losses, moved))
    return fits


def test_a_far_capture_is_fitted_like_one_at_the_origin(near_and_far):
    (near, near_losses, _), (far, far_losses, _) = near_and_far
    assert (near.scene.origin == 0).all()
    np.testing.assert_allclose(far.scene.origin, PLACE, atol=1)
    np.testing.assert_allclose(far_losses, near_losses, rtol=1e-3)


def test_pictures_of_a_far_scene_are_taken_with_the_cameras_of_its_world(near_and_far):
    views = [
        next(render_cameras(trainer.scene, SMALL, capture.cameras[:1], 4))[1]
        for trainer, _, capture in near_and_far
    ]
    assert views[0].opacity.max() > 0.9
    np.testing.assert_allclose(views[1].opacity, views[0].opacity, atol=0.02)


def test_a_checkpoint_keeps_where_a_far_scene_is(near_and_far, tmp_path):
    trainer, _, capture = near_and_far[1]
    again, _ = resumed(trainer, tmp_path, capture, ball_capture()[1])
    np.testing.assert_array_equal(again.scene.origin, trainer.scene.origin)
    # The next step is the one that the fit itself takes: its rays start where they did.
    assert again.advance(0.99)["image"] == pytest.approx(trainer.advance(0.99)["image"], rel=1e-5)


def test_a_given_region_is_in_the_capture_s_own_coordinates():
    capture, photos = ball_capture()
    moved = seen_from(capture, -PLACE)
    box = np.array([PLACE - 0.9, PLACE + 0.9])
    settings = dataclasses.replace(SMALL, fit=dataclasses.replace(SMALL.fit, use_masks=False))
    scene = new_trainer(moved, photos, settings, 0, box, "cpu", lambda fraction: None).scene
    np.testing.assert_allclose(scene.field.centre.numpy() + scene.origin, PLACE, atol=1e-5)
    assert scene.field.half_size == pytest.approx(0.9)


def test_a_tiny_capture_is_counted_from_within_its_own_size():
    capture, _ = ball_capture()
    small = placed(capture, np.diag([1e-4, 1e-4, 1e-4, 1.0]))
    far = seen_from(small, np.array([-0.7, 3.3, 0.05]))
    near = seen_from(far, far_origin(far))
    size = float((near.region[1] - near.region[0]).max())
    assert np.abs(near.region).max() < 3 * size < np.abs(far.region).max() / 100


def test_captures_as_they_usually_are_keep_their_coordinates():
    capture, _ = ball_capture()
    for distance in (0, 3, 500):
        assert (far_origin(seen_from(capture, np.array([-distance, 0, 0]))) == 0).all()
