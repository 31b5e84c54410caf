"""Settings, the visual hull, checkpoints, and that a fit learns."""

import dataclasses
import os
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from safetensors import SafetensorError

from solver import replacing
from solver.capture.camera import Camera
from solver.capture.capture import Capture
from solver.capture.errors import CaptureError
from solver.capture.photos import Photo
from solver.fit import checkpoint, reconstruct
from solver.fit.chunk import ChunkLoss
from solver.fit.clock import FitClock
from solver.fit.errors import SettingsError
from solver.fit.losses import photometric, total_loss
from solver.fit.presets import PRESETS, settings_for
from solver.fit.priors import coloured_light
from solver.fit.ray_bank import RayBank, RayBatch
from solver.fit.schedule import neural_share, smoothing_width
from solver.fit.settings import Settings
from solver.fit.start import background_of, masks_of, new_trainer, trainer_for
from solver.fit.visual_hull import bounding_box, carve, signed_distance
from solver.job.control import Control
from solver.job.events import EventStream
from solver.job.folder import JobFolder
from solver.job.progress import Progress
from solver.job.request import JobError, JobRequest
from solver.job.status import Heartbeat
from solver.render.radiance import RayBuffers
from solver.render.scene import StepTables
from solver.render.surroundings import Surroundings
from solver.render.tonemap import linear_to_srgb
from tests.capture.test_capture import pose

RADIUS, SIZE = 0.6, 32
SMALL = settings_for(
    "draft",
    {
        "field.sizes": "24,32", "field.size_starts": "0,0.5", "light.heights": "16,32", "fit.rays": "256",
        "field.hull_cells": "48", "field.occupancy_cells": "32",
        "render.secondary_rays": "4", "field.turn_box": "no",
    },
)  # fmt: skip


def ball_capture(views=10, colour=(0.5, 0.2, 0.1)):
    """Photos of an evenly coloured ball at the origin, with alpha."""
    cameras, photos = [], []
    for i in range(views):
        matrix = pose(2 * np.pi * i / views)
        camera = Camera(f"r_{i}", None, matrix, SIZE, SIZE, 60.0, 60.0, SIZE / 2, SIZE / 2)
        row, column = np.mgrid[0:SIZE, 0:SIZE]
        origins, directions = camera.rays(column.ravel() + 0.5, row.ravel() + 0.5)
        closest = np.linalg.norm(np.cross(origins, directions), axis=1)
        alpha = (closest < RADIUS).astype(np.float32)[:, None]
        pixels = np.concatenate([alpha * np.float32(colour), alpha], 1).reshape(SIZE, SIZE, 4)
        cameras.append(camera)
        photos.append(Photo(pixels.astype(np.float32), True, False))
    region = np.array([[-1.0] * 3, [1.0] * 3])
    return Capture("memory", tuple(cameras), region), photos


def trained(steps=0, seed=0):
    capture, photos = ball_capture()
    trainer = new_trainer(capture, photos, SMALL, seed, None, "cpu", lambda fraction: None)
    losses = [trainer.advance(i / max(steps, 1))["image"] for i in range(steps)]
    return trainer, losses, capture, photos


def resumed(trainer, folder, capture, photos):
    """A trainer that goes on from the checkpoint of another, and the settings it found there."""
    checkpoint.save_checkpoint(trainer, folder / "checkpoint", 1.0, done=False)
    scene, state, tensors = checkpoint.load_scene(folder / "checkpoint")
    settings = checkpoint.settings_of(state)
    other = trainer_for(scene, capture, photos, settings, trainer.seed)
    checkpoint.restore(other, state, tensors)
    return other, settings


def test_the_visual_hull_of_a_ball_holds_the_ball_and_little_more():
    capture, photos = ball_capture(24)
    hull = carve(list(capture.cameras), masks_of(photos), capture.region, 40)
    ticks = (np.arange(40) + 0.5) / 20 - 1
    distance = np.linalg.norm(np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), -1), axis=-1)
    assert hull[distance < RADIUS - 0.1].all()
    equator = hull & (np.abs(ticks)[None, None] < 0.2)
    assert not equator[distance > RADIUS + 0.15].any()
    low, high = bounding_box(hull, capture.region)
    np.testing.assert_allclose(high[:2], RADIUS, atol=0.1)
    np.testing.assert_allclose(low[:2], -RADIUS, atol=0.1)


def test_signed_distance_of_a_ball_agrees_with_its_formula():
    ticks = (np.arange(40) + 0.5) / 20 - 1
    grid = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), -1)
    truth = np.linalg.norm(grid, axis=-1) - RADIUS
    result = signed_distance(truth < 0) * 0.05
    near = np.abs(truth) < 0.4
    assert np.abs(result - truth)[near].max() < 0.06


def test_masks_without_common_ground_are_an_error():
    capture, photos = ball_capture()
    empty = dataclasses.replace(photos[0], pixels=np.zeros_like(photos[0].pixels))
    with pytest.raises(CaptureError, match="masks"):
        new_trainer(capture, [empty, *photos[1:]], SMALL, 0, None, "cpu", lambda fraction: None)


def test_a_fit_starts_opaque_but_not_so_deep_that_hollows_could_not_be_carved():
    trainer, _, _, _ = trained()
    field = trainer.scene.field
    along = torch.linspace(-0.5, 0.5, 60)[:, None] * torch.tensor([1.0, 0.0, 0.0])
    raw = field.raw_density(field.to_box(along)).detach()
    passing = torch.exp(-field.extinction(raw).mean())
    assert float(passing) < 1e-6 and float(raw.max()) < 8
    outside = field.raw_density(field.to_box(torch.tensor([[0.9 * field.half_size] * 3])))
    assert float(field.extinction(outside.detach())) < 1e-3


def test_a_fit_learns_the_colour_of_a_ball():
    trainer, losses, *_ = trained(60)
    assert np.mean(losses[-5:]) < 0.4 * losses[0]


def test_a_fit_is_the_same_for_the_same_seed():
    assert trained(4, seed=1)[1] == trained(4, seed=1)[1]
    assert trained(4, seed=1)[1] != trained(4, seed=2)[1]


def test_a_resumed_fit_goes_on_as_if_nothing_had_happened(tmp_path):
    trainer, _, capture, photos = trained(0)
    for i in range(6):
        trainer.advance(i / 20)
    other, settings = resumed(trainer, tmp_path, capture, photos)
    assert settings == SMALL
    expected = [trainer.advance(i / 20)["image"] for i in range(6, 14)]
    result = [other.advance(i / 20)["image"] for i in range(6, 14)]
    np.testing.assert_allclose(result, expected, rtol=1e-4)


def test_a_fit_under_a_time_limit_is_resumed_where_it_was_not_where_its_steps_say(tmp_path):
    """A fixed bug: the schedule ran backwards, and the grids shrank."""
    trainer, _, capture, photos = trained(0)
    for fraction in (0.0, 0.5, 0.9):
        trainer.advance(fraction)
    size, rows = trainer.scene.field.size, trainer.scene.environment.height
    other, settings = resumed(trainer, tmp_path, capture, photos)
    assert other.fraction == 0.9
    clock = FitClock(settings, other.fraction, 100.0)
    assert 0.9 <= clock.fraction(other.step) < 0.91
    assert FitClock(settings, other.fraction, None).fraction(other.step) == 0.9
    other.advance(0.1)
    assert (other.scene.field.size, other.scene.environment.height) == (size, rows)


def test_a_checkpoint_has_the_depths_at_corners_which_are_nothing_where_nothing_may_be(tmp_path):
    """A fixed bug: what the field holds outside, which no photo knows, blocked light."""
    trainer, *_ = trained(1)
    occupancy = trainer.scene.occupancy
    occupancy.allowed = occupancy.allowed.clone()
    occupancy.allowed[: len(occupancy.allowed) // 2] = False
    trainer.refresh_occupancy()
    folder = tmp_path / "checkpoint"
    checkpoint.save_checkpoint(trainer, folder, 1.0, done=False)
    found = checkpoint.load_scene(folder)[0].occupancy.corner_depth
    assert float(found.amax()) > 0 == float(found[: len(found) // 2].amax())
    torch.testing.assert_close(found, occupancy.corner_depth, rtol=0, atol=0)


def test_a_checkpoint_does_not_hold_on_to_its_file(tmp_path):
    """Windows lets nobody replace a file that is mapped into memory."""
    trainer, *_ = trained(1)
    folder = tmp_path / "checkpoint"
    checkpoint.save_checkpoint(trainer, folder, 1.0, done=False)
    held = checkpoint.load_scene(folder)
    alone = [checkpoint.read_tensor(folder, name) for name in held[2]]
    maps = Path("/proc/self/maps")
    if os.name == "nt":
        folder.rename(tmp_path / "elsewhere")
    elif not maps.exists():
        pytest.skip("what is mapped is read in /proc")
    else:
        assert str(folder) not in maps.read_text()
    assert held and len(alone) > 10


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ({"field.sizes": "128"}, "1 sizes and 3 starts"),
        ({"field.size_starts": "0.1,0.2,0.3"}, "the first must be 0"),
        ({"field.size_starts": "0,0.5,0.2"}, "must increase"),
        ({"fit.neural_fade": "0.5"}, "2 numbers"),
    ],
)
def test_settings_that_do_not_fit_each_other_are_told_before_a_job_begins(overrides, words):
    with pytest.raises(SettingsError, match=words):
        settings_for("draft", overrides)
    assert settings_for("draft", {"field.sizes": "32", "field.size_starts": "0"}).field.sizes == (32,)


def test_the_last_checkpoint_stays_where_a_full_disk_takes_no_other(tmp_path, monkeypatch):
    trainer, *_ = trained(1)
    folder = tmp_path / "checkpoint"
    checkpoint.save_checkpoint(trainer, folder, 1.0, done=False)

    def full(tensors, path):
        path.write_bytes(b"half")
        raise SafetensorError("Error while serializing: I/O error: No space left on device")

    monkeypatch.setattr(checkpoint, "save_file", full)
    trainer.step = 2
    with pytest.raises(JobError, match=f"^{re.escape(str(tmp_path))}: .*No space.*; free space"):
        checkpoint.save_checkpoint(trainer, folder, 2.0, done=False)
    assert checkpoint.load_scene(folder)[1]["step"] == 1
    monkeypatch.undo()
    checkpoint.save_checkpoint(trainer, folder, 2.0, done=False)
    assert checkpoint.load_scene(folder)[1]["step"] == 2


def test_a_checkpoint_interrupted_while_renaming_is_found(tmp_path):
    trainer, *_ = trained(1)
    folder = tmp_path / "checkpoint"
    checkpoint.save_checkpoint(trainer, folder, 1.0, done=False)
    folder.rename(tmp_path / "checkpoint.old")
    assert checkpoint.read_state(folder)["step"] == 1
    with pytest.raises(JobError, match="no checkpoint"):
        checkpoint.load_scene(tmp_path / "elsewhere")


def test_a_fit_outlives_previews_and_checkpoints_that_somebody_has_open(tmp_path, monkeypatch):
    """Windows lets nobody replace them then."""
    often = dataclasses.replace(SMALL.fit, steps=7, preview_every=0.0, checkpoint_every=0.0)
    capture, photos = ball_capture()
    settings = dataclasses.replace(SMALL, fit=often)
    trainer = new_trainer(capture, photos, settings, 0, None, "cpu", lambda fraction: None)
    job = JobFolder.create(tmp_path / "job", JobRequest(capture="memory"))
    progress = Progress(EventStream(job.events_path), Heartbeat(job.status_path), bar=False)
    progress.stage("fit")
    at_steps = {"render.png": (2, 3), "checkpoint.old": (3,), "checkpoint": (4, 5)}
    replace, denied = os.replace, {}

    def held(source, target):
        name = Path(target).name
        if trainer.step in at_steps.get(name, ()):
            denied.setdefault(name, []).append(job.has_checkpoint())
            raise PermissionError(13, "Access is denied", str(target))
        replace(source, target)

    monkeypatch.setattr(os, "replace", held)
    monkeypatch.setattr(replacing, "_patiently", lambda work, seconds: work())
    monkeypatch.setattr(reconstruct, "PREVIEW_PAUSE", 0.0)
    reconstruct.fit(trainer, job, progress, Control(job.cancel_path, False), None, 0.0)
    assert {name: len(there) for name, there in denied.items()} == {
        name: len(steps) for name, steps in at_steps.items()
    }
    assert all(all(there) for there in denied.values()), "a checkpoint is there all the time"
    state = checkpoint.read_state(job.checkpoint_dir)
    assert state["done"] and state["step"] == trainer.step == 7


def test_the_neural_term_fades_out_before_the_end():
    fit = settings_for("draft", {"fit.neural_start": "1"}).fit
    shares = [neural_share(fit, fraction) for fraction in (0.0, 0.4, 0.5, 0.65, 1.0)]
    assert shares[0] == 1 and shares[-1] == shares[-2] == 0
    assert all(a >= b for a, b in zip(shares, shares[1:], strict=False))


def test_the_smoothing_of_normals_narrows_to_its_end():
    field = settings_for("draft", {"field.smoothing": "0.03,0.01"}).field
    widths = [smoothing_width(field, fraction) for fraction in np.linspace(0, 1, 9)]
    assert (np.diff(widths) < 0).all()
    np.testing.assert_allclose([widths[0], widths[-1]], field.smoothing, rtol=1e-6)
    assert smoothing_width(settings_for("paper").field, 0.0) == 0.0


def test_a_finished_fit_keeps_the_normals_it_ended_with(tmp_path):
    wide = dataclasses.replace(SMALL, field=dataclasses.replace(SMALL.field, smoothing=(0.1, 0.05)))
    capture, photos = ball_capture()
    trainer = new_trainer(capture, photos, wide, 0, None, "cpu", lambda fraction: None)
    trainer.advance(0.5)
    checkpoint.save_checkpoint(trainer, tmp_path / "checkpoint", 1.0, done=True)
    scene, _, _ = checkpoint.load_scene(tmp_path / "checkpoint")
    assert scene.field.smoothing == trainer.scene.field.smoothing > 0
    for ours, theirs in zip(scene.normal_tables(), trainer.scene.normal_tables(), strict=True):
        torch.testing.assert_close(ours, theirs)


def test_presets_are_valid_and_settings_convert():
    assert all(isinstance(preset, Settings) for preset in PRESETS.values())
    changed = settings_for("draft", {"fit.steps": "7", "field.sizes": "8,16,32", "render.visibility": "no"})
    assert (
        changed.fit.steps == 7 and changed.field.sizes == (8, 16, 32) and changed.render.visibility is False
    )


@pytest.mark.parametrize("key", ["fit.nothing", "nothing.steps", "steps", "fit.steps"])
def test_a_wrong_setting_is_named(key):
    with pytest.raises(SettingsError, match=key):
        settings_for("draft", {key: "many"})


def test_an_unknown_preset_is_named():
    with pytest.raises(SettingsError, match="draft"):
        settings_for("fastest")


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("fit.steps", "a whole number"),
        ("fit.neighbour_distance", "a number"),
        ("fit.neural_fade", "2 numbers"),
        ("fit.snapshots", "a list of whole numbers"),
    ],
)
def test_what_a_setting_expects_is_told_with_its_article(key, words):
    with pytest.raises(SettingsError, match=rf"expected {words}\.$"):
        settings_for("draft", {key: "soon"})


def test_batches_hold_the_pixels_of_their_rays():
    capture, photos = ball_capture(3)
    bank = RayBank(list(capture.cameras), photos)
    pixel = torch.tensor([0, SIZE * 16 + 16, SIZE * SIZE * 2 + SIZE * 16 + 16])
    batch = bank.batch(pixel)
    assert batch.alpha.tolist() == [0, 1, 1]
    _, expected = capture.cameras[2].rays(np.array([16.5]), np.array([16.5]))
    np.testing.assert_allclose(batch.directions[2, 0].numpy(), expected[0], atol=1e-6)
    np.testing.assert_allclose(batch.origins[2].numpy(), capture.cameras[2].position, atol=1e-6)


def test_a_saturated_pixel_forgives_more_light_but_not_less():
    def loss(radiance):
        ones = torch.ones(1)
        buffers = dataclasses.make_dataclass("B", ["radiance", "opacity", "halves"])(
            torch.full((1, 3), radiance), ones, None
        )
        clipped = torch.ones(1, 3, dtype=torch.bool)
        batch = RayBatch(None, None, torch.ones(1, 3), ones, ones > 0, clipped, ones, torch.zeros(1).long())
        return float(photometric(buffers, batch, torch.ones(1, 3)))

    assert loss(3.0) == 0 and loss(0.5) > 0.01


def test_noise_of_a_pixels_rays_is_no_error_if_there_are_several():
    """Where it is one, lights and lobes that make less noise win over the true ones."""
    count, true = 200_000, 0.5
    generator = torch.Generator().manual_seed(0)
    radiance = true + 0.05 * torch.randn(count, 2, 3, generator=generator)
    ones, white = torch.ones(count), torch.ones(count, 3)
    halves = torch.cat([radiance, torch.ones(count, 2, 1)], 2)
    batch = RayBatch(
        None, None, linear_to_srgb(torch.full((count, 3), true)), ones, ones > 0,
        torch.zeros(count, 3).bool(), ones, ones.long(),
    )  # fmt: skip

    def loss(halves):
        buffers = SimpleNamespace(radiance=radiance.mean(1), opacity=ones, halves=halves)
        return float(photometric(buffers, batch, white))

    variance = float(linear_to_srgb(radiance.mean(1)).var())
    assert loss(None) == pytest.approx(variance, rel=0.02)
    assert abs(loss(halves)) < 0.02 * variance


@pytest.mark.parametrize("shown", [True, False], ids=["surroundings", "colour"])
def test_halves_that_agree_change_nothing(shown):
    generator = torch.Generator().manual_seed(0)
    seen, behind, before, colour = (torch.rand(50, 4, generator=generator) for _ in range(4))
    behind = Surroundings(before[:, :3], before[:, 3], behind[:, :3]) if shown else behind[:, :3]
    ones, gain = torch.ones(50), 0.5 + colour
    batch = RayBatch(
        None, None, colour[:, :3], gain[:, 3] - 0.5, ones > 0, colour[:, :3] > 0.8, ones, ones.long()
    )

    def loss(halves):
        buffers = SimpleNamespace(radiance=seen[:, :3], opacity=seen[:, 3], halves=halves)
        return photometric(buffers, batch, behind, gain[:, :3])

    torch.testing.assert_close(loss(torch.stack([seen, seen], 1)), loss(None))
    away = torch.tensor([0.1, 0.1, 0.1, 0.0])
    assert loss(torch.stack([seen + away, seen - away], 1)) < loss(None)


def test_pixels_of_several_rays_are_told_without_noise_unless_a_preset_is_the_papers():
    for preset, unbiased in (("draft", True), ("standard", True), ("paper", False)):
        settings = settings_for(preset, {"render.pixel_grid": 2})
        loss = ChunkLoss(settings, True, "white", False)
        assert loss.render_settings(0.9).widening_gradient is unbiased
        assert loss.render_settings(0.1).widening_gradient is False


def test_opacity_is_held_to_alpha_only_where_that_is_known():
    opacity = torch.full((2,), 0.3, requires_grad=True)
    buffers = RayBuffers(
        torch.zeros(2, 3), opacity, torch.zeros(2, 3), torch.zeros(2, 3), torch.zeros(2),
        torch.zeros(2, 3), torch.zeros(2), torch.zeros(2), 0, 0, 0,
    )  # fmt: skip
    ones = torch.ones(2)
    batch = RayBatch(
        None, None, torch.ones(2, 3), ones, torch.tensor([True, False]), torch.zeros(2, 3).bool(), ones,
        torch.zeros(2).long(),
    )  # fmt: skip
    fit = dataclasses.replace(SMALL.fit, mask_weight=2.0, opacity_weight=0.0, orientation_weight=0.0)

    def pull(use_masks):
        white = torch.ones(2, 3)
        masked, _ = total_loss(buffers, batch, fit, use_masks, 0.0, white)
        (gradient,) = torch.autograd.grad(masked - photometric(buffers, batch, white), opacity)
        return gradient.tolist()

    assert pull(True) == pytest.approx([2.0 * (0.3 - 1), 0.0])
    assert pull(False) == [0.0, 0.0]


@pytest.mark.parametrize("fraction", [0.0, 0.5, 1.0])
def test_smoothness_fades_to_its_end(fraction):
    parts = torch.tensor([0.2, 0.4]), torch.tensor([1.0, 3.0])
    empty, flat = torch.zeros(2, 3), torch.zeros(2)
    ones = torch.ones(2)
    batch = RayBatch(None, None, empty, ones, ones > 0, empty.bool(), ones, ones.long())
    fit = dataclasses.replace(SMALL.fit, bend_weight=2.0, unevenness_weight=0.5, smoothness_end=0.25)

    def loss(bending, unevenness):
        buffers = RayBuffers(
            empty, flat, empty, empty, flat, empty, flat, flat, 0, 0, 0, bending, unevenness
        )
        return float(total_loss(buffers, batch, fit, True, fraction, empty)[0])

    expected = 0.25**fraction * (2.0 * 0.3 + 0.5 * 2.0)
    assert loss(*parts) - loss(None, None) == pytest.approx(expected, rel=1e-5)


def stayed_at(fraction, steps, **changes):
    """A trainer whose steps all count as the same fraction of the fit."""
    settings = dataclasses.replace(SMALL, fit=dataclasses.replace(SMALL.fit, **changes))
    capture, photos = ball_capture()
    trainer = new_trainer(capture, photos, settings, 0, None, "cpu", lambda fraction: None)
    for _ in range(steps):
        trainer.advance(fraction)
    return trainer


def mean_material(name, steps, fraction, **changes):
    trainer = stayed_at(fraction, steps, **changes)
    with torch.no_grad():
        features = trainer.scene.field.features(torch.rand(500, 3))
        return float(getattr(trainer.scene.field.materials(features), name).mean())


def test_the_pull_on_roughness_makes_surfaces_sharper_and_is_gone_at_the_end():
    def mean_roughness(weight, fraction):
        return mean_material("alpha", 12, fraction, roughness_weight=weight)

    last = np.nextafter(1.0, 0.0)
    assert mean_roughness(10.0, 0.1) < mean_roughness(0.0, 0.1) - 1e-3
    assert mean_roughness(10.0, last) == pytest.approx(mean_roughness(0.0, last), rel=1e-3)


def test_the_pull_to_dielectrics_begins_when_metals_have_got_away():
    def mean_f0(weight, fraction):
        return mean_material("f0", 30, fraction, dielectric_weight=weight)

    assert mean_f0(1.0, 0.5) < 0.995 * mean_f0(0.0, 0.5)
    assert mean_f0(1.0, 0.1) == pytest.approx(mean_f0(0.0, 0.1), rel=1e-6)


def test_the_colour_of_a_red_ball_goes_to_the_light_unless_that_is_held_grey_which_one_in_the_photos_is_not():
    def colour(weight, background="auto"):
        trainer = stayed_at(0.5, 15, grey_light_weight=weight, background=background)
        return float(coloured_light(StepTables.of(trainer.scene).light).detach())

    assert colour(1.0) < 0.5 * colour(0.0)
    assert colour(1.0, "environment") == colour(0.0, "environment") > 0


def test_the_background_is_recognised():
    _, masked = ball_capture(2)
    white = [Photo(np.ones((8, 8, 4), np.float32), False, False)] * 2
    room = [Photo(np.full((8, 8, 4), 0.3, np.float32), False, False)] * 2
    assert background_of(masked) == background_of(white) == "white"
    assert background_of(room) == "room"
