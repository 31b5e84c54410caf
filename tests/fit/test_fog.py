"""Captures without masks: the fog, where it may be, and colours before reflections."""

import dataclasses

import numpy as np
import pytest
import torch

from solver.capture.photos import Photo, linear_to_srgb
from solver.capture.placement import placed
from solver.fit.presets import PAPER, FitSettings, emission_share, picture_settings
from solver.fit.preview import display, over_white
from solver.fit.start import background_of, new_trainer
from solver.fit.visual_hull import seen_cells
from solver.metrics.image import psnr
from solver.render.image import image_settings, render_view
from solver.render.radiance import render_rays
from solver.render.random_numbers import RandomNumbers
from solver.render.scene import RenderSettings, StepTables
from tests.fit.test_fit import RADIUS, SMALL, ball_capture
from tests.render.scenes import ball, camera_rays, refresh


def room_capture():
    """The ball before a grey room, without alpha."""
    capture, photos = ball_capture()
    shot = []
    for photo in photos:
        alpha = photo.pixels[..., 3:]
        pixels = photo.pixels + (1 - alpha) * np.array([0.3, 0.35, 0.4, 1.0], np.float32)
        shot.append(Photo(pixels.astype(np.float32), False, False))
    return capture, shot


def test_a_point_that_shines_sends_its_own_colour_whatever_the_light():
    scene = ball(0.5, albedo=0.3)
    refresh(scene)
    settings = image_settings(RenderSettings(neural=0.0, retraced_rays=0), 4)
    origins, directions = camera_rays(6)

    def radiance(emission):
        with torch.no_grad():
            return render_rays(
                scene, StepTables.of(scene), dataclasses.replace(settings, emission=emission),
                RandomNumbers(0), origins, directions, torch.arange(len(origins)), jitter=False,
            )  # fmt: skip

    lit, glowing, half = radiance(0.0), radiance(1.0), radiance(0.5)
    torch.testing.assert_close(glowing.radiance, glowing.albedo)
    torch.testing.assert_close(half.radiance, 0.5 * (lit.radiance + glowing.radiance))


def test_emission_fades_for_a_fog_and_pictures_never_have_it():
    fit = FitSettings(emission_fade=(0.1, 0.3))
    assert [emission_share(fit, f) for f in (0.0, 0.1, 0.2, 0.3, 1.0)] == pytest.approx(
        [1, 1, 0.5, 0, 0]
    )
    assert emission_share(PAPER.fit, 0.0) == 0
    assert image_settings(RenderSettings(emission=1.0)).emission == 0


@pytest.mark.parametrize("masked", [True, False])
def test_only_a_fit_without_masks_starts_by_shining(masked):
    capture, photos = ball_capture() if masked else room_capture()
    trainer = new_trainer(capture, photos, SMALL, 0, None, "cpu", lambda fraction: None)
    assert trainer.emission(0.0) == (0.0 if masked else 1.0)
    assert trainer.background == ("white" if masked else "environment")


def test_a_fog_before_a_room_becomes_the_ball():
    capture, photos = room_capture()
    trainer = new_trainer(capture, photos, SMALL, 0, None, "cpu", lambda fraction: None)
    losses = [trainer.advance(i / 300)["image"] for i in range(300)]
    assert np.mean(losses[-20:]) < 0.15 * np.mean(losses[:5])
    field = trainer.scene.field

    def extinction(points):
        return float(field.extinction(field.raw_density(field.to_box(points))).detach().mean())

    shell = 0.97 * RADIUS * torch.nn.functional.normalize(torch.randn(500, 3), dim=-1)
    around = 1.5 * shell
    assert extinction(shell) > 2 * extinction(around)


def test_cells_are_where_several_cameras_look_and_none_is_close():
    capture, _ = ball_capture(10)
    region = np.array([[-6.0] * 3, [6.0] * 3])
    seen = seen_cells(list(capture.cameras), region, 48)
    ticks = (np.arange(48) + 0.5) / 4 - 6
    points = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), -1)
    assert seen[np.linalg.norm(points, axis=-1) < 0.6].all()
    for camera in capture.cameras:
        assert not seen[np.linalg.norm(points - camera.position, axis=-1) < 0.5].any()
    assert not seen[np.abs(points[..., 2]) > 5.5].any()
    assert 0.01 < seen.mean() < 0.5


@pytest.mark.parametrize("make", [ball_capture, room_capture])
def test_a_capture_may_be_of_any_size(make):
    capture, photos = make()

    def losses(scale):
        bigger = placed(capture, np.diag([scale, scale, scale, 1.0]))
        trainer = new_trainer(bigger, photos, SMALL, 0, None, "cpu", lambda fraction: None)
        return [trainer.advance(i / 40)["image"] for i in range(40)]

    usual = losses(1.0)
    for scale in (0.02, 30.0):
        np.testing.assert_allclose(losses(scale)[-10:], usual[-10:], rtol=0.05)


def test_a_photo_with_its_room_is_compared_with_the_light_behind_the_object():
    capture, photos = room_capture()
    trainer = new_trainer(capture, photos, SMALL, 0, None, "cpu", lambda fraction: None)
    for i in range(60):
        trainer.advance(i / 60)
    scene, camera = trainer.scene, capture.cameras[0]
    view = render_view(scene, StepTables.of(scene), picture_settings(SMALL, 4), camera)
    before_light = display(view, background_of(photos))
    truth = over_white(photos[0].pixels)
    assert psnr(before_light, truth) > psnr(display(view), truth) + 3
    corner = view.backdrop[0, 0] * (1 - view.opacity[0, 0]) + view.radiance[0, 0]
    np.testing.assert_allclose(before_light[0, 0], np.clip(linear_to_srgb(corner), 0, 1), atol=1e-6)
