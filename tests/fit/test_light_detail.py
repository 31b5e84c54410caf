"""What of the light's detail is told by what mirrors it, and what is taken away."""

import math

import numpy as np
import pytest
import torch

from solver.brdf.microfacet import fresnel_schlick
from solver.fit import light_detail
from solver.fit.light_detail import OpenDetail, open_detail
from solver.fit.presets import settings_for
from solver.fit.start import new_trainer
from solver.light.environment import EnvironmentMap, equirect_coordinates
from solver.light.smoothing import draw_colours_together, draw_together
from tests.fit.test_fit import ball_capture, resumed

SMALL = {
    "field.sizes": "24", "field.size_starts": "0", "light.heights": "64", "fit.rays": "512",
    "field.hull_cells": "48", "field.occupancy_cells": "32", "render.secondary_rays": "4",
    "light.step_smoothing": "0", "field.turn_box": "no",
}  # fmt: skip
SIGMA = 3 * math.pi / 64
"""of the light's blur, rad"""


def ball(**settings):
    """A trainer at the start of a fit of a ball, and its capture and photos."""
    capture, photos = ball_capture()
    chosen = settings_for("draft", SMALL | settings)
    return (
        new_trainer(capture, photos, chosen, 0, None, "cpu", lambda fraction: None),
        capture,
        photos,
    )


def opened(trainer, turn=None):
    steps = [(chunks, (turn,)) for chunks, _ in trainer.some_pixels(4)]
    return open_detail(trainer.scene, trainer.loss, steps, [3.0])[0]


def test_more_of_a_wider_blur_is_told():
    trainer, _, _ = ball(**{"field.initial_roughness": "0.15"})
    steps = trainer.some_pixels(4)
    narrow, wide = open_detail(trainer.scene, trainer.loss, steps, [3.0, 6.0])
    assert narrow[24:40].mean() == pytest.approx(0.15**2 / SIGMA, rel=0.15)
    assert wide[24:40].mean() == pytest.approx(0.5 * float(narrow[24:40].mean()), rel=0.01)


@pytest.mark.parametrize("roughness, share", [(0.15, 0.15**2 / SIGMA), (0.9, 1.0), (0.03, 0.02)])
def test_a_ball_leaves_open_what_is_finer_than_its_lobes(roughness, share):
    trainer, _, _ = ball(**{"field.initial_roughness": str(roughness)})
    found = opened(trainer)
    assert found.shape == (64, 128) and found.min() >= 0 and found.max() <= 1
    # Cameras stand around the equator.
    assert found[24:40].mean() == pytest.approx(share, rel=0.15)


def test_what_no_surface_mirrors_is_all_open(monkeypatch):
    trainer, _, _ = ball(**{"field.initial_roughness": "0.03"})
    monkeypatch.setattr(light_detail, "SOLID", 2.0)
    assert (opened(trainer) == 1).all()


def test_shares_are_harmonic_means_by_what_is_reflected():
    """Against a loop over pixels, without a blur of the counts."""
    trainer, _, _ = ball(**{"field.initial_roughness": "0.3"})
    with torch.no_grad():  # rough on one side, smooth on the other
        trainer.scene.field.feature_planes.normal_(0, 0.5)
    rows = light_detail.ROWS
    ((chunks, turns),) = trainer.some_pixels(1)
    found = opened_without_blur(trainer, [(chunks, turns)])
    counts = np.zeros((rows, 2 * rows, 2))
    tables = light_detail.SharedTables.of(trainer.scene, turns)
    for chunk in chunks:
        with torch.no_grad():
            seen = trainer.loss.pixels(trainer.scene, tables.under(0), chunk)
        for i in range(len(seen.opacity)):
            if seen.opacity[i] <= 0.5:
                continue
            normal = seen.normal[i] / seen.normal[i].norm()
            view = chunk.batch.directions[i].mean(0)
            view = view / view.norm()
            mirror = view - 2 * min(float(view @ normal), 0.0) * normal
            u = 0.5 - math.atan2(mirror[1], mirror[0]) / (2 * math.pi)
            v = math.acos(float(mirror[2].clamp(-1, 1))) / math.pi
            row, column = min(int(v * rows), rows - 1), min(int(u * 2 * rows), 2 * rows - 1)
            cosine = max(-float(view @ normal), 0.0)
            f0 = seen.f0[i] / seen.opacity[i]
            weight = float(fresnel_schlick(f0, torch.tensor(cosine)).mean())
            share = min(max(float(seen.alpha[i] / seen.opacity[i]) / SIGMA, 0.02), 1)
            counts[row, column] += weight, weight / share
    few = light_detail.FEW * counts[..., 0].mean()
    expected = (counts[..., 0] + few) / (counts[..., 1] + few)
    assert expected.std() > 0.01
    off = np.abs(found - expected)
    # A direction on the edge of two texels may be counted in either.
    assert (off < 1e-3).mean() > 0.99


def opened_without_blur(trainer, steps):
    """`open_detail` on its own map of counts."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(light_detail, "map_smoothing", lambda sigma: lambda counts: counts)
        patch.setattr(light_detail, "resized_map", lambda shares, height: shares)
        return open_detail(trainer.scene, trainer.loss, steps, [3.0])[0].numpy()


def test_a_light_that_turned_is_told_where_it_was_before():
    """A turn by 90° about +Z: what is mirrored at a longitude came from 90° less, a quarter of the map."""
    trainer, _, _ = ball(**{"field.initial_roughness": "0.1"})
    ((chunks, _),) = trainer.some_pixels(1)
    turn = torch.tensor([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    still, turned = (opened_without_blur(trainer, [(chunks, (t,))]) for t in (None, turn))
    x_axis = torch.tensor([[1.0, 0.0, 0.0]])
    at, before = (
        equirect_coordinates(d, light_detail.ROWS, 2 * light_detail.ROWS)[0, 0]
        for d in (x_axis @ turn.T, x_axis)
    )
    shift = round(float(before - at))
    assert abs(shift) == light_detail.ROWS // 2
    same = np.abs(np.roll(still, shift, axis=1) - turned) < 1e-3
    assert same.mean() > 0.99 and not (np.abs(still - turned) < 1e-3).mean() > 0.99


def late_light(first, **settings):
    """The light that steps of a fit from the fraction `first` on end with, from one of fine lines."""
    trainer, _, _ = ball(**{"field.initial_roughness": "0.8", "fit.rays": "64", **settings})
    light = trainer.scene.environment
    lines = 0.3 * torch.cos(torch.pi * torch.arange(2.0 * light.height) / 2)
    light.log_radiance.data.copy_(lines.expand_as(light.log_radiance))
    for step in range(16):
        trainer.advance(first + step / 100)
    return light.log_radiance.detach()


STRONG = {"light.smoothness": "60", "light.colour_smoothness": "60"}
NONE = {"light.smoothness": "0", "light.colour_smoothness": "0"}


def test_late_steps_take_lines_from_the_light_that_a_rough_ball_does_not_tell():
    free, smooth = (late_light(0.7, **settings)[:, 24:40].std(-1).mean() for settings in (NONE, STRONG))
    assert smooth < 0.5 * free


@pytest.mark.parametrize("which", [0, 1])
def test_detail_and_colours_have_each_their_share_and_blur(which):
    detail = OpenDetail(settings_for("draft").light)
    torch.manual_seed(0)
    light, expected = EnvironmentMap(256), EnvironmentMap(256)
    light.log_radiance.data.normal_(0, 0.5)
    start = light.log_radiance.detach().clone()
    expected.log_radiance.data.copy_(start)
    detail.share = torch.zeros(2, 256, 512)
    detail.share[which] = 0.5
    detail.take_away(light, 16, 0.01)
    if which == 0:
        draw_together(expected, 3.0, torch.tensor(0.5 * 8 * 0.01))
    else:
        draw_colours_together(expected, 12.0, torch.tensor(0.5 * 8 * 0.01))
    torch.testing.assert_close(light.log_radiance, expected.log_radiance, atol=1e-4, rtol=0)
    assert (light.log_radiance - start).abs().max() > 0.01
    before = light.log_radiance.detach().clone()
    detail.take_away(light, 17, 0.01)  # every eighth step
    assert (light.log_radiance == before).all()


def test_late_steps_draw_colours_together_that_a_rough_ball_does_not_tell():
    def colours(**settings):
        trainer, _, _ = ball(**{"field.initial_roughness": "0.8", "fit.rays": "64", **settings})
        light = trainer.scene.environment
        torch.manual_seed(0)
        light.log_radiance.data.normal_(0, 0.5)
        brightness = light.radiance().detach().mean(0)
        for step in range(16):
            trainer.advance(0.7 + step / 100)
        radiance = light.radiance().detach()
        change = (radiance.mean(0) / brightness).log().abs().mean()
        return (radiance / radiance.mean(0)).log().std(0)[24:40].mean(), change

    only = {"light.smoothness": "0"}
    free, kept = colours(**NONE)
    drawn, kept_too = colours(**only, **{"light.colour_smoothness": "60"})
    assert drawn < 0.3 * free
    assert kept_too < 1.5 * kept


@pytest.mark.parametrize(
    "first, others",
    [
        (0.3, {}),
        (0.7, {"fit.background": "environment"}),
        (0.7, {"field.initial_roughness": "0.01"}),
    ],
)
def test_early_steps_lights_that_photos_show_and_mirrors_leave_the_light_alone(first, others):
    none, strong = (late_light(first, **settings, **others) for settings in (NONE, STRONG))
    if "field.initial_roughness" in others:  # all but a fiftieth
        none, strong = (light[:, 24:40].std(-1).mean() for light in (none, strong))
        assert strong == pytest.approx(float(none), rel=0.05)
    else:
        assert (none == strong).all()


def test_a_map_of_few_rows_is_smoothed_by_a_narrower_blur():
    assert torch.isfinite(late_light(0.7, **STRONG, **{"light.heights": "4"})).all()


def test_a_resumed_fit_goes_on_with_what_it_found_to_be_open(tmp_path):
    trainer, capture, photos = ball(**{"fit.rays": "64"})
    trainer.advance(0.7)
    assert trainer.open_detail.share is not None
    other, settings = resumed(trainer, tmp_path, capture, photos)
    torch.testing.assert_close(other.open_detail.share, trainer.open_detail.share)
    for one in (trainer, other):
        for step in range(9):
            one.advance(0.701 + step / 1000)
    lights = (one.scene.environment.log_radiance for one in (trainer, other))
    torch.testing.assert_close(*lights)


def test_the_papers_light_keeps_its_detail():
    assert not OpenDetail(settings_for("paper").light).wanted(1.0)
    for preset in ("draft", "standard"):
        detail = OpenDetail(settings_for(preset).light)
        assert [detail.wanted(f) for f in (0.0, 0.59, 0.6, 0.99)] == [False, False, True, True]
