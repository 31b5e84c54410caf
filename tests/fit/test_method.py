"""The paper's machinery: its preset, the ablations, batching, backgrounds, a shared decoder, snapshots."""

import dataclasses
import math

import numpy as np
import pytest
import torch
from PIL import Image

from benchmarks.quality import ABLATIONS
from solver.fit import checkpoint
from solver.fit.batching import FIRST_RAYS, Batching
from solver.fit.errors import SettingsError
from solver.fit.presets import PAPER, settings_for
from solver.fit.schedule import neural_share
from solver.fit.settings import FitSettings
from solver.fit.snapshots import write_figure, write_snapshot
from solver.fit.start import background_of, new_trainer
from solver.job.folder import JobFolder
from solver.job.request import JobRequest
from tests.fit.test_fit import SMALL, ball_capture, resumed

SMALL_PAPER = {
    "field.sizes": "16,20,24", "field.size_starts": "0,0.3,0.6", "light.heights": "16",
    "field.occupancy_cells": "32", "fit.rays": "64", "fit.most_rays": "128", "fit.samples": "4000",
    "fit.secondary_samples": "3000", "render.secondary_rays": "16", "render.retraced_rays": "50",
    "field.turn_box": "no",
}  # fmt: skip


def start(settings, seed=0):
    capture, photos = ball_capture()
    return new_trainer(capture, photos, settings, seed, None, "cpu", lambda fraction: None)


def test_the_paper_preset_carries_the_papers_numbers():
    render, fit, field = PAPER.render, PAPER.fit, PAPER.field
    assert (render.secondary_rays, fit.steps, fit.warm_up) == (128, 30000, 100)
    assert (field.sizes[0], field.sizes[-1]) == (128, 300)
    starts = [round(fraction * fit.steps) for fraction in field.size_starts]
    assert starts == [0, 2000, 3000, 4000, 5500, 7000]
    # Cube-root linear in the number of voxels: the edges are evenly spaced.
    np.testing.assert_allclose(np.diff(field.sizes), (300 - 128) / 5, atol=1)
    assert (fit.learning_rate_grid, fit.learning_rate_network) == (0.02, 1e-3)
    assert fit.final_learning_rate == 1e-3 and not fit.use_masks and not render.visibility
    assert neural_share(fit, 0.0) == neural_share(fit, 1.0) == 1.0


def test_the_learning_rate_follows_the_papers_formula_and_restarts_with_the_grid():
    trainer = start(settings_for("paper", SMALL_PAPER))

    def factor(steps, fraction, fraction_at_level=0.0):
        trainer.steps_at_level, trainer.fraction_at_level = steps, fraction_at_level
        return trainer._learning_rate_factor(fraction)

    def formula(i, fraction):
        warm = 0.1 + 0.9 * math.sin(0.5 * math.pi * min(i / 100, 1))
        return warm * math.exp(fraction * math.log(1e-3))

    for steps, fraction in ((0, 0.0), (37, 0.001), (100, 0.1), (9000, 1.0)):
        assert factor(steps, fraction) == pytest.approx(formula(steps, fraction))
    assert factor(0, 0.3, 0.3) == pytest.approx(0.1)
    assert factor(500, 0.4, 0.3) == pytest.approx(formula(500, 0.1))


def test_the_paper_preset_learns_from_fog_without_masks():
    trainer = start(settings_for("paper", {**SMALL_PAPER, "fit.warm_up": "5"}))
    assert not trainer.use_masks and trainer.background == "white"
    assert trainer.scene.occupancy.allowed.all()
    losses = [trainer.advance(i / 120)["image"] for i in range(120)]
    assert np.mean(losses[-5:]) < 0.2 * np.mean(losses[:5])
    assert trainer.scene.field.size == 24


@pytest.mark.parametrize("name", ABLATIONS)
@pytest.mark.parametrize("preset", ["draft", "paper"])
def test_every_ablation_is_a_setting_that_changes_the_fit(name, preset):
    base = SMALL_PAPER
    if preset == "draft":
        base = {
            "field.sizes": "24", "field.size_starts": "0", "light.heights": "16", "fit.rays": "128",
            "field.hull_cells": "48", "field.occupancy_cells": "32",
        }  # fmt: skip
    # `draft` has no neural term that could be left out.
    base = {**base, "fit.neural_start": 1.0}
    default, ablated = settings_for(preset, base), settings_for(preset, {**base, **ABLATIONS[name]})
    assert default != ablated
    losses = []
    for settings in (default, ablated):
        trainer = start(settings)
        trainer.batching.first_retraced = trainer.batching.retraced = settings.render.retraced_rays
        losses.append([trainer.advance(i / 10)["image"] for i in range(4)])
    assert np.isfinite(losses).all() and losses[0] != losses[1]


def test_batches_hold_about_the_same_number_of_samples_whatever_rays_take():
    settings = FitSettings(rays=400, most_rays=8000, samples=10_000)
    batching = Batching(settings, 0)
    assert batching.chunks() == [FIRST_RAYS] * 4
    for samples_per_ray, expected in ((250.0, 40), (2.0, 5000), (0.5, 8000)):
        for _ in range(200):
            rays = batching.chunks()[0]
            batching.observe(rays, round(rays * samples_per_ray), 0, 0)
        chunks = batching.chunks()
        assert chunks[0] == pytest.approx(expected, rel=0.15)
        assert 400 <= sum(chunks) <= 8000


def test_a_step_has_as_many_pixels_whatever_rays_they_have_and_a_chunk_as_many_rays():
    batching = Batching(FitSettings(rays=2048, rays_at_once=512), 0)
    assert batching.chunks() == [512] * 4
    assert batching.chunks(4) == [128] * 16
    assert Batching(FitSettings(rays=1500, rays_at_once=512), 0).chunks() == [500] * 3
    assert Batching(FitSettings(rays=2048), 0).chunks(4) == [2048], "as few as memory allows"
    turned = Batching(FitSettings(rays=2048), 0, least=4)
    assert turned.chunks() == turned.chunks(4) == [512] * 4, "for each of some photos has tables"
    full = Batching(FitSettings(rays=400, most_rays=8000, samples=10_000), 0)
    assert full.chunks(4) == [FIRST_RAYS // 4] * 16


def test_several_rays_a_pixel_fit_and_resume_as_if_nothing_had_happened(tmp_path):
    render = dataclasses.replace(SMALL.render, pixel_grid=2, secondary_rays=8)
    fit = dataclasses.replace(SMALL.fit, pixel_grid_start=0.5, rays=128)
    trainer = start(dataclasses.replace(SMALL, render=render, fit=fit))
    reports = [trainer.advance(i / 20) for i in range(14)]
    assert [report["rays"] for report in reports] == [128] * 10 + [512] * 4
    other, _ = resumed(trainer, tmp_path, *ball_capture())
    expected = [trainer.advance(i / 20)["image"] for i in range(14, 20)]
    result = [other.advance(i / 20)["image"] for i in range(14, 20)]
    np.testing.assert_allclose(result, expected, rtol=1e-3)
    assert expected[-1] < reports[0]["image"]


def test_a_sudden_fog_shrinks_the_batch_at_once():
    batching = Batching(FitSettings(rays=400, most_rays=8000, samples=10_000), 0)
    for _ in range(50):
        batching.observe(100, 200, 0, 0)
    batching.observe(100, 40_000, 0, 0)
    assert batching.chunk < 40


def test_retraced_rays_follow_the_samples_they_take():
    batching = Batching(FitSettings(samples=1000, secondary_samples=50_000), 1000)
    assert batching.retraced == 1000
    for _ in range(30):
        batching.observe(100, 100, batching.retraced, batching.retraced * 10)
    assert batching.retraced == pytest.approx(5000, rel=0.01)
    batching.observe(100, 100, 5000, 5000 * 40)
    assert batching.retraced == pytest.approx(1250, rel=0.01)


def test_a_card_with_room_takes_several_chunks_at_once_with_the_retraced_rays_of_all():
    settings = FitSettings(rays=400, most_rays=8000, samples=10_000)
    for room, sizes, retraced in ((1, [100] * 4, 70), (3, [300, 100], 210), (9, [400], 280)):
        batching = Batching(settings, 70, room)
        assert batching.chunks() == sizes
        assert batching.retraced_of(sizes[0] / 400, sizes[0]) == retraced
    # What is cut by rays, not by samples, has its share of them, whatever room there is.
    by_rays = Batching(FitSettings(rays=2048, rays_at_once=512), 1000, 6)
    assert by_rays.chunks() == [512] * 4 and by_rays.retraced_of(0.25, 512) == 250
    by_secondary = Batching(FitSettings(secondary_samples=1000), 1000, 6)
    assert by_secondary.retraced_of(1.0, 8192) == 1000


def test_a_step_cut_in_chunks_has_the_gradient_of_the_whole():
    whole = start(SMALL)
    cut = start(SMALL)
    cut.batching.settings = dataclasses.replace(SMALL.fit, samples=10**9, most_rays=256)
    for chunk, trainer in ((256, whole), (64, cut)):
        trainer.batching.chunk = chunk
        pixels = torch.arange(256) * 37 % len(trainer.bank)
        queue = iter(pixels.split(chunk))
        trainer.bank.draw = lambda count, generator, photo, queue=queue: next(queue)
        trainer.random.step = 0
    # A step clears the gradients that it used, so take them instead of the step.
    gradients = []
    for trainer in (whole, cut):
        assert sum(trainer.batching.chunks()) == 256
        trainer.optimiser.step = list
        trainer.advance(0.0)
        gradients.append([p.grad.clone() for p in trainer.scene.parameters() if p.grad is not None])
    for a, b in zip(*gradients, strict=True):
        # R retraced rays a chunk instead of R a step: a different, equally fair choice.
        assert float((a - b).norm()) < 0.2 * float(a.norm()) + 1e-6
    assert sum(float(a.norm()) for a in gradients[0]) > 1e-3


def test_the_paper_preset_resumes_as_if_nothing_had_happened(tmp_path):
    trainer = start(settings_for("paper", SMALL_PAPER))
    for i in range(12):
        trainer.advance(i / 30)
    other, settings = resumed(trainer, tmp_path, *ball_capture())
    assert settings == trainer.settings
    expected = [trainer.advance(i / 30)["image"] for i in range(12, 20)]
    result = [other.advance(i / 30)["image"] for i in range(12, 20)]
    np.testing.assert_allclose(result, expected, rtol=1e-3)


def test_what_photos_hardly_tell_of_the_light_stays_as_it_was():
    moved = []
    for floor in (0.0, 0.3):
        fit = dataclasses.replace(SMALL.fit, light_floor_without_room=floor)
        trainer = start(dataclasses.replace(SMALL, fit=fit))
        before = trainer.scene.environment.log_radiance.detach().clone()
        for step in range(10):
            trainer.advance(step / 40)
        moved.append((trainer.scene.environment.log_radiance.detach() - before).abs())
    least, most = (torch.stack([m.quantile(q) for m in moved]) for q in (0.1, 0.95))
    assert float(least[1]) < 0.5 * float(least[0])
    assert float(most[1]) > 0.7 * float(most[0])


def test_an_analytical_derivative_survives_a_checkpoint(tmp_path):
    settings = dataclasses.replace(SMALL, field=dataclasses.replace(SMALL.field, smoothed_normals=False))
    checkpoint.save_checkpoint(start(settings), tmp_path / "checkpoint", 0.0, done=True)
    scene, *_ = checkpoint.load_scene(tmp_path / "checkpoint")
    assert scene.field.smoothed_normals is False


@pytest.mark.parametrize("background", ["white", "black", "random", "environment"])
def test_a_fit_learns_before_every_background(background):
    settings = dataclasses.replace(SMALL, fit=dataclasses.replace(SMALL.fit, background=background))
    trainer = start(settings)
    assert trainer.background == background
    losses = [trainer.advance(i / 40)["image"] for i in range(40)]
    assert np.mean(losses[-5:]) < 0.7 * losses[0]


def test_backgrounds_that_cannot_be_are_refused():
    _, photos = ball_capture(2)
    opaque = [dataclasses.replace(photo, has_alpha=False) for photo in photos]
    with pytest.raises(SettingsError, match="random"):
        background_of(opaque, "random")
    with pytest.raises(SettingsError, match="'pink' is not allowed; choose one of auto, white"):
        settings_for("draft", {"fit.background": "pink"})


def test_a_decoder_can_be_taken_over_and_stays_as_it_is(tmp_path):
    first = start(SMALL)
    for i in range(5):
        first.advance(i / 20)
    job = JobFolder.create(tmp_path / "first", JobRequest(capture="none", device="cpu"))
    checkpoint.save_checkpoint(first, job.checkpoint_dir, 0.0, done=True)
    fit = dataclasses.replace(SMALL.fit, decoder=str(tmp_path / "first"))
    second = start(dataclasses.replace(SMALL, fit=fit), seed=3)
    for i in range(5):
        second.advance(i / 20)
    for name in ("field.basis", "field.heads", "neural"):
        kept, new = (t.scene.get_submodule(name).state_dict() for t in (first, second))
        assert all(torch.equal(kept[key], new[key]) for key in kept), name
    assert not torch.equal(first.scene.field.feature_planes, second.scene.field.feature_planes)
    fields = dataclasses.replace(SMALL.field, feature_size=8)
    with pytest.raises(SettingsError, match="feature_size"):
        start(dataclasses.replace(SMALL, fit=fit, field=fields))


@pytest.mark.parametrize("heights, last", [((8, 16), 16), ((8, 12, 24), 24), ((8,), 8)])
def test_a_fit_so_short_that_it_skips_a_grid_ends_with_the_last_light_all_the_same(heights, last):
    field = dataclasses.replace(SMALL.field, sizes=(12, 14, 16), size_starts=(0.0, 0.3, 0.6))
    light = dataclasses.replace(SMALL.light, heights=heights)
    trainer = start(dataclasses.replace(SMALL, field=field, light=light))
    trainer.advance(0.0)
    assert trainer.scene.environment.height == 8
    trainer.advance(0.9)
    assert (trainer.scene.field.size, trainer.scene.environment.height) == (16, last)


def test_snapshots_show_render_weights_and_light(tmp_path):
    trainer = start(SMALL)
    write_snapshot(trainer, tmp_path, 0.0)
    trainer.advance(0.0)
    write_snapshot(trainer, tmp_path, 0.1)
    names = {path.name for path in tmp_path.iterdir()}
    parts = ("render", "weights", "environment")
    assert names == {f"{part}_{step:06d}.png" for part in parts for step in (0, 1)}
    weights = np.asarray(Image.open(tmp_path / "weights_000000.png").convert("L"))
    assert weights.min() < 128 and weights.max() == 255
    figure = Image.open(write_figure(tmp_path))
    assert figure.width > 2 * 32
    assert write_figure(tmp_path / "nothing") is None
