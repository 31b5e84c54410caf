"""A fit of panoramas alone, whose pictures begin anywhere, finds the object that they go around."""

import numpy as np
import pytest

from solver.capture.camera import Camera
from solver.capture.capture import Capture, region_seen_by
from solver.capture.photos import Photo
from solver.fit.load import render_cameras
from solver.fit.start import new_trainer
from tests.capture.test_panoramas_around import mask_of_ball, upright_panoramas
from tests.fit.test_fit import SMALL

COLOUR = np.float32((0.5, 0.2, 0.1))


def photo_of_ball(camera):
    alpha = mask_of_ball(camera).astype(np.float32)[..., None]
    return Photo(np.concatenate([alpha * COLOUR, alpha], axis=-1), True, False)


@pytest.fixture(scope="module")
def fitted():
    cameras = upright_panoramas(12)
    capture = Capture("memory", tuple(cameras), region_seen_by(cameras))
    photos = [photo_of_ball(camera) for camera in cameras]
    trainer = new_trainer(capture, photos, SMALL, 0, None, "cpu", lambda fraction: None)
    losses = [trainer.advance(step / 30)["image"] for step in range(30)]
    return trainer, losses


def test_the_colours_of_panoramas_are_learnt(fitted):
    _, losses = fitted
    assert np.mean(losses[-5:]) < 0.6 * losses[0]


def test_the_object_is_where_it_is_for_cameras_of_other_places_and_kinds(fitted):
    trainer, _ = fitted
    elsewhere = upright_panoramas(3, height=0.0, seed=5, width=64)[1:2]
    pose = np.eye(4)
    pose[:3, :3] = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # looks along +Y
    pose[:3, 3] = 0, -2.0, 0
    elsewhere.append(Camera("flat", None, pose, 40, 40, 40.0, 40.0, 20.0, 20.0))
    for camera, view in render_cameras(trainer.scene, SMALL, tuple(elsewhere), 4, neural=0.0):
        shown, wanted = view.opacity > 0.5, mask_of_ball(camera)
        assert (shown & wanted).sum() > 0.75 * (shown | wanted).sum(), camera.name
