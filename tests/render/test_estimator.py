"""The shading estimator against brute-force quadrature; reciprocity; furnaces with every term on."""

import dataclasses
import math

import numpy as np
import pytest
import torch

from solver.brdf.microfacet import (
    fresnel_schlick,
    ggx_distribution,
    masking_shadowing_over_masking,
    smith_lambda,
    visible_normal_pdf,
)
from solver.kernels.march import MOST_SAMPLES
from solver.light.environment import EnvironmentMap, equirect_directions
from solver.render.composition import Composition, Placement
from solver.render.radiance import render_rays
from solver.render.random_numbers import RandomNumbers
from solver.render.scene import RenderSettings, Samples, StepTables
from solver.render.shade import shade
from tests.render.scenes import ball, camera_rays

ONE_BOUNCE = RenderSettings(neural=0.0, retraced_rays=0, visibility=False)
F0 = 0.3


def smooth_light(height=64):
    """A light with a broad bright side, so that lobes of all widths see it differently."""
    directions = equirect_directions(height, 2 * height).float()
    toward = torch.nn.functional.normalize(torch.tensor([0.8, 0.3, 0.6]), dim=0)
    glow = torch.exp(6 * ((directions @ toward) - 1))
    colour = torch.tensor([4.0, 2.0, 1.0])
    return EnvironmentMap.from_radiance(0.2 + glow[..., None] * colour)


def shaded(scene, settings, view, rays, seed=0, times=1):
    """Radiance leaving the ball's pole along `view`, by the renderer's own estimator, `times` over."""
    index = torch.arange(times)
    points = torch.tensor([[0.0, 0.0, 0.5]]).expand(times, 3)
    samples = Samples(points, torch.ones(times), index, 7 + MOST_SAMPLES * index)
    random = RandomNumbers(seed, points=8192)
    tables, view = StepTables.of(scene), view.expand(times, 3)
    return shade(scene, tables, settings, random, samples, view, torch.ones(times), rays)


def by_quadrature(light, alpha, view, side=1500):
    """∫ F D G2/(4 n·v n·l) L (n·l) dl over half vectors, with a normal along +Z.

    Midpoints of the inverse of D's own distribution: another way than visible normals.
    """
    u = (np.arange(side) + 0.5) / side
    tangent = alpha * np.sqrt(u / (1 - u))
    cosine = 1 / np.sqrt(1 + tangent**2)
    sine = tangent * cosine
    phi = 2 * math.pi * (np.arange(side) + 0.5) / side
    half = np.stack(
        [sine[:, None] * np.cos(phi), sine[:, None] * np.sin(phi), np.repeat(cosine[:, None], side, 1)],
        -1,
    ).reshape(-1, 3)
    half = torch.from_numpy(half)
    view = view.double()
    view_half = half @ view
    direction = 2 * view_half[:, None] * half - view
    above = (direction[:, 2] > 1e-4) & (view_half > 0)
    half, view_half, direction = half[above], view_half[above], direction[above]
    a = torch.full((len(half),), alpha, dtype=torch.float64)
    view_z = torch.full_like(a, float(view[2]))
    distribution = ggx_distribution(half[:, 2], a)
    both = 1 / (1 + smith_lambda(view_z, a) + smith_lambda(direction[:, 2], a))
    fresnel = fresnel_schlick(torch.full((len(half), 1), F0, dtype=torch.float64), view_half)
    brdf_cosine = fresnel[:, 0] * distribution * both / (4 * view_z)
    density = distribution * half[:, 2] / (4 * view_half)
    point = torch.zeros(len(half))
    radiance = light.lookup(light.tables(), direction.float(), point).double()
    return ((brdf_cosine / density)[:, None] * radiance).sum(0) / side**2


@pytest.mark.parametrize("roughness", [0.9, 0.4, 0.08], ids=["rough", "glossy", "mirror-like"])
@pytest.mark.parametrize("degrees", [10, 60])
def test_the_specular_estimate_is_the_integral(roughness, degrees):
    light = smooth_light()
    scene = ball(sharpness=2000.0, albedo=1e-6, f0=F0, roughness=roughness, environment=light)
    angle = math.radians(degrees)
    view = torch.tensor([[math.sin(angle), 0.0, math.cos(angle)]])
    result = shaded(scene, ONE_BOUNCE, view, 4096)
    normal = result.normals[0]
    assert normal[2] > 0.9999
    expected = by_quadrature(light, roughness**2, view[0])
    torch.testing.assert_close(result.radiance[0].double(), expected, rtol=0.02, atol=2e-3)


@pytest.mark.parametrize(("integral_image", "tolerance"), [(False, 0.02), (True, 0.06)])
def test_one_ray_agrees_with_many_on_average(integral_image, tolerance):
    """As a point lookup a lone ray is unbiased; its wide footprint in the light costs a few percent."""
    light = EnvironmentMap.from_radiance(1 + 0.5 * equirect_directions(64, 128).float())
    scene = ball(sharpness=2000.0, albedo=1e-6, f0=F0, roughness=0.5, environment=light)
    view = torch.tensor([[0.6, 0.0, 0.8]])
    many = shaded(scene, ONE_BOUNCE, view, 4096).radiance[0]
    settings = dataclasses.replace(ONE_BOUNCE, integral_image=integral_image)
    few = shaded(scene, settings, view, 1, times=20_000).radiance
    torch.testing.assert_close(few.mean(0), many, rtol=tolerance, atol=0)


def test_the_specular_brdf_is_reciprocal():
    generator = torch.Generator().manual_seed(0)
    pair = torch.randn(2, 500, 3, generator=generator, dtype=torch.float64)
    pair[..., 2] = pair[..., 2].abs() + 0.05
    a, b = torch.nn.functional.normalize(pair, dim=-1)
    alpha = torch.rand(500, generator=generator, dtype=torch.float64) * 0.9 + 0.05
    f0 = torch.full((500, 1), F0, dtype=torch.float64)

    def brdf(view, light):
        half = torch.nn.functional.normalize(view + light, dim=-1)
        weight = fresnel_schlick(f0, (view * half).sum(-1))[:, 0]
        weight = weight * masking_shadowing_over_masking(view[:, 2], light[:, 2], alpha)
        return weight * visible_normal_pdf(view[:, 2], half[:, 2], alpha) / light[:, 2]

    torch.testing.assert_close(brdf(a, b), brdf(b, a), rtol=1e-9, atol=0)


FULL = RenderSettings(
    secondary_rays=64, step=0.25, secondary_step=0.5, secondary_bounce_rays=16,
    retraced_rays=1 << 20, min_weight=0.0,
)  # fmt: skip


def rendered(scene, settings, rays, seed=0):
    origins, directions = rays
    keys = torch.arange(len(origins))
    return render_rays(
        scene, StepTables.of(scene), settings, RandomNumbers(seed), origins, directions, keys, False
    )


@pytest.mark.parametrize("visibility", [True, False])
def test_two_mirrors_facing_each_other_in_a_white_furnace_are_white(visibility):
    """Retraced rays bring the light that the other mirror takes away."""
    mirror = ball(albedo=1e-6, f0=1 - 1e-6, roughness=0.1, radius=0.45, sharpness=2000.0)
    pair = Composition(
        [mirror, mirror],
        [Placement((0.0, 0.0, 0.0)), Placement((0.0, 1.1, 0.0))],
        mirror.environment,
    )
    settings = dataclasses.replace(FULL, neural=0.0, visibility=visibility)
    # Where the first mirror shows the middle of the second, which shows the sky.
    origins, directions = camera_rays(5, extent=0.012)
    rays = origins + torch.tensor([0.0, 0.32, 0.0]), directions
    alone = rendered(mirror, settings, rays)
    buffers = rendered(pair, settings, rays)
    radiance = buffers.radiance / buffers.opacity[:, None]
    assert buffers.retraced_samples > 2 * alone.retraced_samples
    torch.testing.assert_close(radiance, torch.ones_like(radiance), atol=0.08, rtol=0)
    assert abs(float(radiance.detach().mean()) - 1) < 0.03


def test_with_every_term_on_a_furnace_gains_no_energy_head_on():
    scene = ball(albedo=1 - 1e-6, f0=0.3, roughness=0.5)
    buffers = rendered(scene, FULL, camera_rays(9, extent=0.2))
    assert (buffers.radiance / buffers.opacity[:, None]).max() < 1.02


def test_the_neural_term_only_takes_away():
    scene = ball(albedo=0.2, f0=0.5, roughness=0.4)
    rays = camera_rays(9, extent=0.3)
    with_g = rendered(scene, FULL, rays).radiance
    without = rendered(scene, dataclasses.replace(FULL, neural=0.0), rays).radiance
    assert (with_g <= without + 1e-5).all() and (with_g < 0.97 * without).any()


def test_without_the_integral_image_a_lookup_is_a_point():
    """A lamp of a few texels: the average over a wide footprint sees it everywhere, a point does not."""
    radiance = torch.full((64, 128, 3), 0.01)
    radiance[12:15, :4] = 500.0
    light = EnvironmentMap.from_radiance(radiance)
    scene = ball(sharpness=2000.0, albedo=1e-6, f0=F0, roughness=0.7, environment=light)
    view = torch.tensor([[0.6, 0.0, 0.8]])
    points = dataclasses.replace(ONE_BOUNCE, integral_image=False)

    def values(settings):
        return torch.stack([shaded(scene, settings, view, 16, s).radiance[0, 0] for s in range(100)])

    assert values(points).std() > 3 * values(ONE_BOUNCE).std()


@pytest.mark.parametrize("roughness", [0.6, 0.1])
def test_the_papers_rectangle_is_inverted(roughness, monkeypatch):
    """Appendix A: a ray stands for d/(N·p) texels, not for N·p/d; d is the texels per steradian.

    A small lamp in the lobe, integrated by brute force. With the inverted size a rough surface sees
    the lamp by chance, and a mirror sees it blurred.
    """
    radiance = torch.full((64, 128, 3), 0.01)
    radiance[12:15, [126, 127, 0, 1]] = 500.0
    light = EnvironmentMap.from_radiance(radiance)
    scene = ball(sharpness=2000.0, albedo=1e-6, f0=F0, roughness=roughness, environment=light)
    view = torch.tensor([[0.6, 0.0, 0.8]])
    expected = by_quadrature(light, roughness**2, view[0]).float()

    def error():
        values = [shaded(scene, ONE_BOUNCE, view, 16, s).radiance[0] for s in range(60)]
        return float((torch.stack(values) - expected).detach().square().mean().sqrt())

    derived = error()
    right_size = EnvironmentMap.footprint

    def inverted(self, row, variance):
        texels_per_steradian = (
            self.height
            * self.width
            / (2 * math.pi**2 * torch.sin(row * math.pi / self.height).clamp(min=1e-4))
        )
        texels_per_steradian = texels_per_steradian[:, None]
        texels = 1 / (variance * texels_per_steradian)
        return right_size(self, row, texels / texels_per_steradian)

    monkeypatch.setattr(EnvironmentMap, "footprint", inverted)
    assert derived < 0.5 * error()
