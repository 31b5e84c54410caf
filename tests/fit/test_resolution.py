"""Grids of photos without masks are no finer than their pixels."""

import dataclasses

import numpy as np
import pytest

from solver.fit.presets import DRAFT, PAPER, STANDARD
from solver.fit.resolution import no_finer_than_photos, pixels_across
from solver.fit.settings import FieldSettings
from solver.fit.start import new_trainer
from tests.cameras.box_scene import box_camera, orbit
from tests.fit.test_fit import SMALL, ball_capture
from tests.fit.test_fog import room_capture

BOX = np.array([[-0.5, -0.5, -0.5], [0.5, 0.5, 0.5]])


def cameras(scale=1.0):
    return [box_camera(pose, scale=scale) for pose in orbit(9)]


def test_pixels_across_are_those_of_the_projected_edge():
    for camera in cameras():
        right = camera.camera_to_world[:3, 0]
        pixel, _ = camera.project(np.stack([-0.5 * right, 0.5 * right]))
        distance = np.linalg.norm(camera.position)
        depth = -(np.linalg.inv(camera.camera_to_world) @ [0, 0, 0, 1])[2]
        # The cameras look a little above the box's middle.
        seen = np.linalg.norm(pixel[1] - pixel[0]) * depth / distance
        assert pixels_across([camera], BOX) == pytest.approx(seen, rel=1e-6)


def test_a_camera_in_the_box_counts_as_one_at_its_wall():
    near = box_camera(np.eye(4))
    assert pixels_across([near], BOX) == pytest.approx(2 * near.fx)


@pytest.mark.parametrize("preset", [DRAFT, STANDARD])
def test_the_finest_grid_has_a_node_a_pixel_and_the_others_follow(preset):
    seen = cameras(0.8)
    field = no_finer_than_photos(preset.field, seen, BOX)
    finest = pixels_across(seen, BOX)
    assert field.sizes[-1] == pytest.approx(finest, abs=0.5)
    ratios = np.array(field.sizes) / field.sizes[-1]
    assert np.allclose(ratios, np.array(preset.field.sizes) / preset.field.sizes[-1], atol=0.01)
    assert field.size_starts == preset.field.size_starts


def test_large_photos_and_the_paper_keep_their_grids():
    assert no_finer_than_photos(STANDARD.field, cameras(4.0), BOX) == STANDARD.field
    assert no_finer_than_photos(PAPER.field, cameras(0.2), BOX) == PAPER.field


def test_tiny_photos_keep_the_coarsest_grid():
    assert no_finer_than_photos(FieldSettings(), cameras(0.02), BOX).sizes[-1] == 96


def test_only_photos_without_masks_make_a_fit_coarser():
    capture, photos = ball_capture()
    coarse, fine = 40, 80
    assert pixels_across(list(capture.cameras), capture.region) < fine
    shape = dataclasses.replace(SMALL.field, sizes=(coarse, fine), size_starts=(0.0, 0.5))
    settings = dataclasses.replace(SMALL, field=shape)

    def started(capture, photos):
        trainer = new_trainer(capture, photos, settings, 0, None, "cpu", lambda done: None)
        assert trainer.scene.field.size == trainer.settings.field.sizes[0]
        return trainer.settings.field.sizes

    assert started(capture, photos) == (coarse, fine)
    assert started(*room_capture())[1] < fine
