"""Steps of the light that are blurred on its map, and a light that is drawn together."""

import numpy as np
import pytest
import torch

from solver.fit.presets import settings_for
from solver.fit.schedule import light_step_width
from solver.fit.start import new_trainer
from solver.kernels.backend import forced_path
from solver.light.environment import EnvironmentMap
from solver.light.smoothing import draw_colours_together, draw_together, map_smoothing
from tests.fit.test_fit import ball_capture


def test_a_blur_is_a_gaussian_of_its_width_and_keeps_the_sum():
    change = torch.zeros(3, 64, 128)
    change[1, 30, 60] = 1
    blurred = map_smoothing(2.5)(change)
    assert blurred.sum() == pytest.approx(1, abs=1e-5) and (blurred[[0, 2]] == 0).all()
    row, column = torch.meshgrid(torch.arange(64.0), torch.arange(128.0), indexing="ij")
    for axis, middle in ((row, 30), (column, 60)):
        assert (blurred[1] * (axis - middle) ** 2).sum() == pytest.approx(2.5**2, rel=0.05)


def test_it_goes_around_the_seam_and_ends_at_the_poles():
    change = torch.zeros(3, 32, 64)
    change[:, 16, 0] = 1
    blurred = map_smoothing(2.0)(change)
    torch.testing.assert_close(blurred[:, :, 1:4], blurred[:, :, -3:].flip(-1))
    even = torch.ones(3, 32, 64)
    torch.testing.assert_close(map_smoothing(4.0)(even), even)


@pytest.mark.parametrize("size", [(3, 24, 48), (1, 32, 64), (2, 3, 6)])
def test_the_kernel_and_plain_torch_blur_alike(size):
    torch.manual_seed(0)
    maps, sigma = torch.randn(size), min(4.0, size[1] / 3)
    with forced_path("torch"):
        plain = map_smoothing(sigma)(maps)
    with forced_path("numba"):
        torch.testing.assert_close(map_smoothing(sigma)(maps), plain)
        # What lies otherwise in memory, too.
        turned = maps.permute(0, 2, 1).contiguous().permute(0, 2, 1)
        torch.testing.assert_close(map_smoothing(sigma)(turned), plain)


def test_a_blur_below_a_third_of_a_texel_is_none():
    assert map_smoothing(0.33) is None and map_smoothing(0.0) is None


@pytest.mark.parametrize("preset", ["draft", "standard"])
def test_steps_are_blurred_ever_less_until_a_share_of_the_fit_and_never_in_the_papers(preset):
    end = 4
    light = settings_for(preset).light
    widths = [light_step_width(light, 64, i / 20) for i in range(21)]
    assert widths[0] == 3.0 and widths[end:] == [0.0] * (21 - end)
    assert all(later < earlier for earlier, later in zip(widths[:end], widths[1 : end + 1], strict=True))
    assert light_step_width(settings_for("paper").light, 512, 0.0) == 0
    assert light_step_width(light, 4, 0.0) == 0.5, "a small map is not blurred around itself"


def test_the_first_steps_of_a_light_have_no_pattern_finer_than_the_blur():
    def fine(texels):
        settings = settings_for("draft", {**FINE, "light.step_smoothing": str(texels)})
        capture, photos = ball_capture()
        trainer = new_trainer(capture, photos, settings, 0, None, "cpu", lambda fraction: None)
        for step in range(8):
            trainer.advance(step / 100)
        light = trainer.scene.environment.log_radiance.detach().numpy()
        steps = np.diff(light, n=2, axis=1)[:, 8:-8]
        return np.abs(steps).mean() / light.std()

    assert fine(3.0) < 0.5 * fine(0.0)


FINE = {
    "field.sizes": "24", "field.size_starts": "0", "light.heights": "64", "fit.rays": "64",
    "field.hull_cells": "48", "field.occupancy_cells": "32", "render.secondary_rays": "4",
    "field.initial_roughness": "0.15",
}  # fmt: skip


def lined(texels):
    """A light with vertical lines, `texels` from one to the next, a channel ever brighter than another."""
    light = EnvironmentMap(64)
    lines = 0.3 * torch.cos(2 * torch.pi * torch.arange(128.0) / texels)
    light.log_radiance.data.copy_(torch.tensor([-1.0, 0.0, 1.0]).view(3, 1, 1) + lines)
    return light


def contrast(light):
    return float(light.log_radiance.detach()[:, 20:44].std(dim=-1).mean())


ALL = torch.tensor(1.0)


def test_a_light_drawn_together_loses_what_is_fine_and_keeps_what_is_wide():
    fine, wide = lined(4), lined(128)
    before = contrast(fine), contrast(wide)
    for light in (fine, wide):
        draw_together(light, 3.0, ALL)
    assert contrast(fine) < 3e-3 * before[0]
    assert contrast(wide) == pytest.approx(before[1], rel=0.03)


def test_a_light_drawn_together_sends_as_much_as_before_wherever_it_comes_from():
    torch.manual_seed(0)
    light = EnvironmentMap(64)
    light.log_radiance.data.normal_(0, 0.4)

    def around(values):
        return map_smoothing(6.0)(values)[:, 8:-8]  # beside the poles there is less around

    before = around(light.radiance().detach())
    logarithms = around(light.log_radiance.detach()).exp()
    for _ in range(4):
        draw_together(light, 3.0, ALL / 2)
    after = around(light.radiance().detach())
    torch.testing.assert_close(after, before, rtol=0.01, atol=0)
    assert (logarithms / before).mean() < 0.95, "a mean of logarithms would send less"


def test_a_light_is_drawn_together_by_the_share_of_each_texel():
    light, share = lined(4), torch.zeros(64, 128)
    own = light.log_radiance.detach().clone()
    draw_together(light, 3.0, share)
    torch.testing.assert_close(light.log_radiance.detach(), own, atol=1e-6, rtol=0)
    draw_together(light, 0.3, ALL)
    torch.testing.assert_close(light.log_radiance.detach(), own, atol=1e-6, rtol=0)
    share[:, 64:] = 0.25
    draw_together(light, 3.0, share)
    left, right = (light.log_radiance.detach()[1, 20:44, 16 + at : 48 + at].std() for at in (0, 64))
    assert left == pytest.approx(float(own[1, 20:44, 16:48].std()), rel=1e-3)
    assert right == pytest.approx(0.75 * float(left), rel=0.01)


def test_a_light_that_is_black_nearly_everywhere_stays_a_number():
    light = EnvironmentMap(64)
    light.log_radiance.data.fill_(-120.0)
    light.log_radiance.data[:, 30, 60] = 3.0
    draw_together(light, 3.0, ALL / 2)
    assert torch.isfinite(light.log_radiance).all()


def coloured(seed=0, contrast=0.5):
    """A light of a map of noise, each channel its own."""
    torch.manual_seed(seed)
    light = EnvironmentMap(64)
    light.log_radiance.data.normal_(0, contrast)
    return light


def colours(light):
    radiance = light.radiance().detach()
    return radiance / radiance.mean(0)


def test_colours_drawn_together_are_those_of_the_energy_around_and_brightness_stays():
    light = coloured()
    before = light.radiance().detach().clone()
    draw_colours_together(light, 6.0, ALL)
    around = map_smoothing(6.0)(before)
    torch.testing.assert_close(colours(light), around / around.mean(0))
    torch.testing.assert_close(light.radiance().detach().mean(0), before.mean(0))


def test_a_lamp_gives_its_colour_to_what_is_around_it_and_keeps_it():
    light = EnvironmentMap(64)
    light.log_radiance.data.copy_(torch.tensor([-3.0, -2.0, -1.0]).view(3, 1, 1).expand(3, 64, 128))
    light.log_radiance.data[:, 30:34, 60:64] = torch.tensor([9.0, 8.0, 7.0]).view(3, 1, 1)
    lamp = colours(light)[:, 32, 62]
    draw_colours_together(light, 6.0, ALL)
    for column in (62, 54):
        torch.testing.assert_close(colours(light)[:, 32, column], lamp, rtol=0.02, atol=0)


def test_colours_that_are_drawn_together_often_keep_the_energy_of_each_channel():
    """A white light, three tenths of whose texels are red; logarithms would make it ever whiter or redder."""
    light = EnvironmentMap(64)
    torch.manual_seed(0)
    red = torch.rand(64, 128) < 0.3
    light.log_radiance.data.fill_(0.0)
    light.log_radiance.data[1:, red] = -7.0

    def around():
        return map_smoothing(12.0)(light.radiance().detach())[:, 16:48]

    before, contrast = around(), colours(light).std()
    for _ in range(30):
        draw_colours_together(light, 6.0, 0.08 * ALL)
    torch.testing.assert_close(around(), before, rtol=0.05, atol=0)
    torch.testing.assert_close(around().mean((1, 2)), before.mean((1, 2)), rtol=0.005, atol=0)
    assert colours(light).std() < 0.5 * contrast


def test_colours_are_drawn_together_by_the_share_of_each_texel():
    light, share = coloured(), torch.zeros(64, 128)
    own = light.log_radiance.detach().clone()
    for sigma in (6.0, 0.3):  # nothing is to be drawn; the blur is none
        draw_colours_together(light, sigma, share if sigma == 6 else ALL)
        torch.testing.assert_close(light.log_radiance.detach(), own, atol=1e-5, rtol=0)
    share[:, 64:] = 0.25
    before = colours(light)
    draw_colours_together(light, 6.0, share)
    after = colours(light)
    left, right = ((a[1, 20:44, at : at + 48].std()) for a, at in ((after, 8), (after, 72)))
    assert left == pytest.approx(float(before[1, 20:44, 8:56].std()), rel=1e-3)
    assert right == pytest.approx(0.75 * float(before[1, 20:44, 72:120].std()), rel=0.02)


def test_colours_of_a_light_that_is_black_nearly_everywhere_stay_numbers():
    light = EnvironmentMap(64)
    light.log_radiance.data.fill_(-120.0)
    light.log_radiance.data[1, 30, 60] = 3.0
    draw_colours_together(light, 6.0, ALL / 2)
    assert torch.isfinite(light.log_radiance).all()
