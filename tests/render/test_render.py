"""Shading and compositing: furnace, unbiased allocation, gradients, tone mapping."""

import dataclasses
import math

import pytest
import torch

from solver.kernels.backend import plain_torch
from solver.kernels.drawing_torch import share_out
from solver.render.radiance import render_rays
from solver.render.random_numbers import RandomNumbers
from solver.render.reflection import choose_systematic
from solver.render.scene import RenderSettings, StepTables
from solver.render.tonemap import linear_to_srgb, over_background, srgb_to_linear
from tests.render.scenes import ball, camera_rays, fill_everywhere

SETTINGS = RenderSettings(neural=0.0, secondary_rays=64, step=0.25)


def render(scene, settings=SETTINGS, seed=0, rays=None):
    origins, directions = rays or camera_rays()
    random = RandomNumbers(seed)
    return render_rays(
        scene, StepTables.of(scene), settings, random, origins, directions,
        torch.arange(len(origins)), jitter=False,
    )  # fmt: skip


def facing(scene, settings=SETTINGS):
    """Radiance over opacity of rays that meet the ball nearly head-on."""
    buffers = render(scene, settings, rays=camera_rays(extent=0.2))
    assert (buffers.opacity > 0.9).all()
    return buffers.radiance / buffers.opacity[:, None]


def test_white_diffuse_ball_in_a_white_furnace_is_white():
    radiance = facing(ball(albedo=1 - 1e-6, f0=1e-6))
    torch.testing.assert_close(radiance, torch.ones_like(radiance), atol=0.02, rtol=0)


def test_smooth_mirror_in_a_white_furnace_is_white():
    radiance = facing(ball(albedo=1e-6, f0=1 - 1e-6, roughness=0.05))
    torch.testing.assert_close(radiance, torch.ones_like(radiance), atol=0.04, rtol=0)


@pytest.mark.parametrize("roughness", [0.1, 0.5, 0.9])
def test_no_material_seen_head_on_gains_energy_in_a_white_furnace(roughness):
    assert facing(ball(albedo=1 - 1e-6, f0=0.3, roughness=roughness)).max() < 1.02


def test_opacity_is_that_of_a_ball():
    scene = ball(radius=0.5, sharpness=2000.0)
    origins, directions = camera_rays()
    closest = torch.linalg.cross(origins, directions).norm(dim=-1)
    opacity = render(scene).opacity
    assert (opacity[closest < 0.45] > 0.95).all()
    assert (opacity[closest > 0.55] < 0.05).all()


def test_normals_are_those_of_a_ball():
    scene = ball(radius=0.5, sharpness=2000.0)
    origins, directions = camera_rays(extent=0.4)
    buffers = render(scene, rays=(origins, directions))
    expected = origins + (buffers.distance / buffers.opacity)[:, None] * directions
    expected = torch.nn.functional.normalize(expected, dim=-1)
    closest = torch.linalg.cross(origins, directions).norm(dim=-1)
    inside = closest < 0.4
    normal = torch.nn.functional.normalize(buffers.normal[inside], dim=-1)
    angle = torch.rad2deg(torch.acos((normal * expected[inside]).sum(-1).clamp(-1, 1)))
    assert angle.mean() < 2.0


def test_plain_torch_renders_the_same_image():
    scene = ball()
    fused = render(scene)
    with plain_torch():
        plain = render(scene)
    torch.testing.assert_close(fused.opacity, plain.opacity, atol=2e-3, rtol=0)
    torch.testing.assert_close(fused.radiance, plain.radiance, atol=0.03, rtol=0)


def test_allocation_of_rays_is_unbiased():
    """The paper's floor(w·M) would give the faint samples none at all."""
    weights = torch.tensor([0.001, 0.004, 0.03, 0.2, 0.765])
    many = 40_000
    along, samples = torch.arange(many).repeat_interleave(5), torch.full((many,), 5)
    u = torch.rand(many, generator=torch.Generator().manual_seed(0))
    counts, share = share_out(16 * weights.repeat(many), along, samples, u)
    expected = weights.double() * 16
    counts, share = counts.view(many, 5).double(), share.view(many, 5).double()
    torch.testing.assert_close(counts.mean(0), expected, rtol=0.1, atol=2e-3)
    assert set(counts.sum(1).tolist()) == {16.0}, "none is left over, none too many"
    torch.testing.assert_close((counts * share).mean(0), torch.ones(5).double(), rtol=0.1, atol=0)


def test_choice_of_retraced_rays_is_unbiased():
    torch.manual_seed(0)
    scores, values = torch.rand(200) ** 3 + 0.05, torch.rand(200)
    estimates = []
    for i in range(2000):
        chosen, probability = choose_systematic(scores, 40, (i + 0.5) / 2000)
        assert len(chosen) <= 41
        estimates.append((values[chosen] / probability).sum())
    torch.testing.assert_close(torch.stack(estimates).mean(), values.sum(), rtol=0.02, atol=0)


def test_all_rays_are_retraced_when_the_budget_allows():
    scores = torch.tensor([0.0, 0.5, 0.1, 0.0, 2.0])
    chosen, probability = choose_systematic(scores, 3, 0.3)
    assert chosen.tolist() == [1, 2, 4]
    assert (probability == 1).all()


def test_the_same_seed_renders_the_same_image():
    scene = ball()
    assert torch.equal(render(scene, seed=5).radiance, render(scene, seed=5).radiance)
    assert not torch.equal(render(scene, seed=5).radiance, render(scene, seed=6).radiance)


def pixel(scene, settings):
    rays = camera_rays(3, extent=0.3)
    return render(scene, settings, rays=rays).radiance.sum()


@pytest.mark.parametrize(
    "name", ["environment.log_radiance", "field.heads.albedo.bias", "field.heads.f0.bias"]
)
def test_gradients_of_pixels_agree_with_finite_differences(name):
    torch.manual_seed(1)
    scene = ball(albedo=0.4, f0=0.2, roughness=0.6)
    settings = dataclasses.replace(SETTINGS, neural=1.0, retraced_rays=0)
    parameter = scene.get_parameter(name)
    direction = torch.randn_like(parameter)
    pixel(scene, settings).backward()
    analytic = float((parameter.grad * direction).sum())
    h = 1e-2
    with torch.no_grad():
        values = []
        for sign in (1, -1):
            parameter.add_(sign * h * direction)
            values.append(float(pixel(scene, settings)))
            parameter.sub_(sign * h * direction)
    assert math.isclose(analytic, (values[0] - values[1]) / (2 * h), rel_tol=0.02, abs_tol=1e-3)


def test_opacity_gradient_by_density_agrees_with_finite_differences():
    scene = ball(sharpness=30.0)
    fill_everywhere(scene)
    parameter = scene.field.density_planes
    direction = torch.ones_like(parameter)
    render(scene).opacity.sum().backward()
    analytic = float((parameter.grad * direction).sum())
    h, values = 5e-3, []
    with torch.no_grad():
        for sign in (1, -1):
            parameter.add_(sign * h * direction)
            values.append(float(render(scene).opacity.sum()))
            parameter.sub_(sign * h * direction)
    assert math.isclose(analytic, (values[0] - values[1]) / (2 * h), rel_tol=0.05)


def test_srgb_round_trips_and_keeps_its_slope_above_one():
    linear = torch.linspace(0, 4, 200, dtype=torch.float64)
    torch.testing.assert_close(srgb_to_linear(linear_to_srgb(linear)), linear)
    bright = torch.tensor([2.0], requires_grad=True)
    linear_to_srgb(bright).backward()
    assert bright.grad > 0.1


def test_straight_alpha_over_white_matches_photos():
    linear, alpha = torch.tensor([[0.2, 0.1, 0.05]]), torch.tensor([0.4])
    expected = linear_to_srgb(linear) * 0.4 + 0.6
    torch.testing.assert_close(over_background(linear * 0.4, alpha, 1.0), expected)
