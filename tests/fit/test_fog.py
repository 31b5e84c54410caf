"""Captures without masks: the fog, where it may be, and colours before reflections."""

import dataclasses

import numpy as np
import pytest
import torch
from PIL import Image

from solver.capture.photos import Photo, linear_to_srgb
from solver.capture.placement import placed
from solver.fit.presets import DRAFT, PAPER, STANDARD
from solver.fit.preview import display, over_plain
from solver.fit.schedule import emission_share, picture_settings
from solver.fit.seen_space import looked_at_most, seen_cells, walked_through
from solver.fit.settings import FitSettings
from solver.fit.snapshots import write_snapshot
from solver.fit.start import background_of, new_trainer
from solver.metrics.image import psnr
from solver.render.image import image_settings, render_view
from solver.render.radiance import render_rays
from solver.render.random_numbers import RandomNumbers
from solver.render.scene import RenderSettings, StepTables
from tests.fit.test_fit import RADIUS, SMALL, ball_capture, resumed
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
    assert [emission_share(fit, f) for f in (0.0, 0.1, 0.2, 0.3, 1.0)] == pytest.approx([1, 1, 0.5, 0, 0])
    assert emission_share(PAPER.fit, 0.0) == 0
    assert image_settings(RenderSettings(emission=1.0)).emission == 0


def test_only_photos_without_masks_make_grids_coarser():
    shape = dataclasses.replace(SMALL.field, finest_without_masks=24)

    def started(capture, photos, shape=shape):
        settings = dataclasses.replace(SMALL, field=shape)
        trainer = new_trainer(capture, photos, settings, 0, None, "cpu", lambda done: None)
        assert trainer.scene.field.size == trainer.settings.field.sizes[0]
        return trainer.settings.field.sizes

    assert SMALL.field.sizes == started(*ball_capture()) == (24, 32)
    assert started(*room_capture()) == (18, 24)
    assert started(*room_capture(), SMALL.field) == (24, 32)


def test_no_preset_but_the_papers_is_finer_than_was_measured_without_masks():
    assert {DRAFT.field.finest_without_masks, STANDARD.field.finest_without_masks} == {160}
    assert DRAFT.field.sizes[-1] == 160 and STANDARD.field.sizes[-1] == 256
    assert PAPER.field.finest_without_masks > PAPER.field.sizes[-1]


def test_a_snapshot_of_a_fog_shows_it_shine(tmp_path):
    trainer = new_trainer(*room_capture(), SMALL, 0, None, "cpu", lambda fraction: None)
    write_snapshot(trainer, tmp_path, 0.0)
    shown = np.asarray(Image.open(tmp_path / "render_000000.png")).astype(np.float32) / 255

    def picture(emission):
        settings = picture_settings(trainer.settings, 32, 0.0, emission=emission)
        scene, camera = trainer.scene, trainer.bank.preview_camera
        return display(render_view(scene, StepTables.of(scene), settings, camera), "room")

    line = trainer.bank.preview_camera.height // 2  # dotted
    others = np.delete(np.arange(len(shown)), line)
    np.testing.assert_allclose(shown[others], picture(1.0)[others], atol=1 / 255)
    assert np.abs(shown - picture(0.0))[others].max() > 3 / 255


@pytest.mark.parametrize("masked", [True, False])
def test_only_a_fit_without_masks_starts_by_shining(masked):
    capture, photos = ball_capture() if masked else room_capture()
    trainer = new_trainer(capture, photos, SMALL, 0, None, "cpu", lambda fraction: None)
    assert trainer.emission(0.0) == (0.0 if masked else 1.0)
    assert trainer.background == ("white" if masked else "room")
    assert (trainer.scene.room is None) == masked


def test_what_materials_usually_are_does_not_count_while_points_shine():
    fit = dataclasses.replace(SMALL.fit, emission_fade=(0.3, 0.6))

    def trainer(weight):
        settings = dataclasses.replace(SMALL, fit=dataclasses.replace(fit, palette_weight=weight))
        return new_trainer(*room_capture(), settings, 0, None, "cpu", lambda fraction: None)

    without, with_it = trainer(0.0), trainer(1.0)

    def same(steps, fraction):
        for fitted in (without, with_it):
            for _ in range(steps):
                fitted.advance(fraction)
        heads = without.scene.field.heads, with_it.scene.field.heads
        return torch.equal(*(h.albedo.weight for h in heads))

    assert same(60, 0.1)
    assert not same(2, 0.5)


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


def test_a_fog_begins_where_most_cameras_look_and_is_let_out_when_it_shines_less():
    capture, photos = room_capture()
    region = np.array([[-4.0] * 3, [4.0] * 3])
    trainer = new_trainer(capture, photos, SMALL, 0, region, "cpu", lambda fraction: None)
    cameras = list(capture.cameras)
    core, seen = (of(cameras, region, 64) for of in (looked_at_most, seen_cells))
    assert core.sum() < 0.7 * seen.sum() and not (core & ~seen).any()
    assert core[29:35, 29:35, 29:35].all()

    def allowed():
        return trainer.scene.occupancy.allowed.float().mean()

    points = np.random.default_rng(0).normal(size=(1200, 3)) * 0.3
    known = dataclasses.replace(capture, points=points)
    told = new_trainer(known, photos, SMALL, 0, region, "cpu", lambda fraction: None)
    # Sparse points, where there are many, say better where something is.
    assert told.scene.occupancy.allowed.float().mean() == pytest.approx(seen.mean(), rel=0.3)
    begun = allowed()
    assert begun == pytest.approx(core.mean(), rel=0.3)
    trainer.advance(0.9 * SMALL.fit.emission_fade[0])
    assert allowed() == begun
    trainer.advance(1.1 * SMALL.fit.emission_fade[0])
    assert allowed() == pytest.approx(seen.mean(), rel=0.3) and allowed() > 1.2 * begun


@pytest.mark.parametrize("make", [ball_capture, room_capture])
def test_a_capture_may_be_of_any_size(make):
    capture, photos = make()
    # Of one secondary ray for each ray of a pixel the noise alone is as large as what is allowed.
    render = dataclasses.replace(SMALL.render, secondary_rays=16)
    settings = dataclasses.replace(SMALL, render=render)

    def losses(scale):
        bigger = placed(capture, np.diag([scale, scale, scale, 1.0]))
        trainer = new_trainer(bigger, photos, settings, 0, None, "cpu", lambda fraction: None)
        return [trainer.advance(i / 40)["image"] for i in range(40)]

    usual = losses(1.0)
    for scale in (0.02, 30.0):
        np.testing.assert_allclose(losses(scale)[-10:], usual[-10:], rtol=0.05)


def test_a_photo_with_its_room_is_compared_with_all_that_is_in_the_scene():
    capture, photos = room_capture()
    trainer = new_trainer(capture, photos, SMALL, 0, None, "cpu", lambda fraction: None)
    for i in range(60):
        trainer.advance(i / 60)
    scene, camera = trainer.scene, capture.cameras[0]
    view = render_view(scene, StepTables.of(scene), picture_settings(SMALL, 4), camera)
    before_light = display(view, background_of(photos))
    truth = over_plain(photos[0].pixels)
    assert psnr(before_light, truth) > psnr(display(view), truth) + 3
    whole = np.clip(linear_to_srgb(view.surrounded), 0, 1)
    np.testing.assert_array_equal(before_light, whole)


def walled_capture(views=12):
    """The ball in a box-shaped room with waves on its walls, which parallax alone tells from far away."""
    capture, photos = ball_capture(views)
    shot = []
    for camera, photo in zip(capture.cameras, photos, strict=True):
        row, column = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
        origins, directions = camera.rays(column.ravel(), row.ravel())
        with np.errstate(divide="ignore"):
            distance = ((np.sign(directions) * 4.5 - origins) / directions).min(1)
        wall = origins + distance[:, None] * directions
        colour = 0.35 + 0.25 * np.sin(2.0 * wall + [0.0, 1.0, 2.0])
        behind = np.concatenate([colour, np.ones((len(colour), 1))], 1).reshape(photo.pixels.shape)
        pixels = photo.pixels + (1 - photo.pixels[..., 3:]) * behind
        shot.append(Photo(pixels.astype(np.float32), False, False))
    return capture, shot


def fitted(capture, photos, background, steps=250):
    settings = dataclasses.replace(
        SMALL, fit=dataclasses.replace(SMALL.fit, background=background, emission_fade=(0.9, 1.0))
    )
    trainer = new_trainer(capture, photos, settings, 0, None, "cpu", lambda fraction: None)
    losses = [trainer.advance(i / steps)["image"] for i in range(steps)]
    return trainer, float(np.mean(losses[-20:]))


def test_walls_near_by_are_explained_by_the_room_where_an_environment_cannot():
    capture, photos = walled_capture()
    trainer, with_room = fitted(capture, photos, "room")
    _, with_environment = fitted(capture, photos, "environment")
    assert with_room < 0.6 * with_environment
    assert all(p.grad is not None for p in trainer.scene.room.parameters())


def test_a_resumed_fit_in_a_room_goes_on_as_if_nothing_had_happened(tmp_path):
    capture, photos = walled_capture(6)
    trainer = new_trainer(capture, photos, SMALL, 0, None, "cpu", lambda fraction: None)
    for i in range(12):  # of them the last after an upsampling
        trainer.advance(i / 20)
    other, _ = resumed(trainer, tmp_path, capture, photos)
    assert other.scene.room.size == 32
    expected = [trainer.advance(i / 20)["image"] for i in range(12, 16)]
    result = [other.advance(i / 20)["image"] for i in range(12, 16)]
    np.testing.assert_allclose(result, expected, rtol=1e-4)


def test_a_fog_is_seen_whole_whatever_the_random_numbers():
    scene = ball(0.5, albedo=0.3, sharpness=4.0)
    refresh(scene)
    settings = RenderSettings(emission=1.0, shaded_depths=2)
    origins, directions = camera_rays(6)
    keys = torch.arange(len(origins))

    def seen(seed):
        tables, random = StepTables.of(scene), RandomNumbers(seed)
        return render_rays(scene, tables, settings, random, origins, directions, keys, jitter=False)

    one, other = seen(0), seen(1)
    torch.testing.assert_close(one.radiance, other.radiance)
    torch.testing.assert_close(one.radiance, 0.3 * one.opacity[:, None].expand(-1, 3), rtol=0.01, atol=1e-3)
    one.radiance.sum().backward()
    assert scene.field.density_planes.grad.abs().max() > 0
    assert scene.field.heads.albedo.bias.grad.abs().max() > 0


def test_the_space_that_cameras_were_carried_through_is_taken_for_empty():
    cameras = list(ball_capture(12)[0].cameras)
    centre = np.zeros(3)
    positions = np.stack([camera.position for camera in cameras])
    assert walked_through(cameras, 0.6 * positions, centre).all()
    assert not walked_through(cameras, 1.3 * positions, centre).any()
    below = np.array([[0.0, 0.0, -0.5], [0.5, 0.0, -1.0]])
    assert not walked_through(cameras, below - [0, 0, abs(positions[:, 2]).max()], centre).any()
    assert not walked_through(cameras[:1], positions, centre).any()
