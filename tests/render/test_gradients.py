"""Gradients of whole pixels against finite differences, for every group of parameters.

Random numbers stay the same while a parameter moves, so both sides see one smooth function, except
where a moving weight changes how many rays a sample gets. Many rays make those jumps small.
"""

import dataclasses

import pytest
import torch

from solver.kernels.backend import plain_torch
from solver.light.environment import EnvironmentMap, equirect_directions
from solver.render.radiance import render_rays
from solver.render.random_numbers import RandomNumbers
from solver.render.scene import RenderSettings, StepTables
from tests.render.scenes import ball, camera_rays, fill_everywhere

SETTINGS = RenderSettings(
    neural=1.0, secondary_rays=512, step=0.5, min_weight=0.0, min_transmittance=0.0,
    retraced_rays=0, visibility=False, neighbour_distance=0.0,
)  # fmt: skip


def scene_with_structure():
    """A soft ball with materials and g that depend on its features, under a coloured sky."""
    sky = equirect_directions(32, 64).float()
    light = EnvironmentMap.from_radiance(1.2 + torch.stack(sky.unbind(-1), -1))
    scene = ball(sharpness=60.0, f0=0.3, roughness=0.6, albedo=0.4, environment=light)
    generator = torch.Generator().manual_seed(3)
    with torch.no_grad():
        for layer in (scene.field.heads.albedo, scene.field.heads.f0, scene.field.heads.roughness):
            layer.weight.copy_(2 * torch.randn(layer.weight.shape, generator=generator))
        scene.neural.layers[-1].weight.mul_(20)
        scene.neural.layers[-1].bias.zero_()
    fill_everywhere(scene)
    return scene


def brightness(scene, settings):
    """A weighted sum of pixel colours and opacities: one number with a gradient everywhere."""
    origins, directions = camera_rays(4, extent=0.45)
    keys = torch.arange(len(origins))
    buffers = render_rays(
        scene, StepTables.of(scene), settings, RandomNumbers(0), origins, directions, keys, False
    )
    weights = torch.linspace(0.5, 1.5, buffers.radiance.numel()).view_as(buffers.radiance)
    return (weights * buffers.radiance).sum() + 0.3 * buffers.opacity.sum()


GROUPS = {
    "density": ["field.density_planes", "field.density_lines"],
    "features": ["field.feature_planes", "field.feature_lines"],
    "feature basis": ["field.basis.weight"],
    "albedo head": ["field.heads.albedo.weight", "field.heads.albedo.bias"],
    "roughness head": ["field.heads.roughness.weight", "field.heads.roughness.bias"],
    "F0 head": ["field.heads.f0.weight", "field.heads.f0.bias"],
    "g": [f"neural.layers.{i}.{kind}" for i in (0, 2, 4) for kind in ("weight", "bias")],
    "environment": ["environment.log_radiance"],
}
STEP = {"environment": 2e-2, "density": 3e-2}
# g takes its directions and α without gradient (paper's Appendix B, public code), so what moves
# directions is compared without it.
MOVES_DIRECTIONS = {"density", "roughness head"}


def directional(scene, settings, names, h):
    """The derivative along the gradient's own direction: by autograd, and by central differences."""
    parameters = [scene.get_parameter(name) for name in names]
    gradients = torch.autograd.grad(brightness(scene, settings), parameters)
    length = sum(float((g * g).sum()) for g in gradients) ** 0.5
    assert length > 1e-3
    values = []
    with torch.no_grad():
        for sign in (1, -1):
            for parameter, gradient in zip(parameters, gradients, strict=True):
                parameter.add_(sign * h / length * gradient)
            values.append(float(brightness(scene, settings)))
            for parameter, gradient in zip(parameters, gradients, strict=True):
                parameter.sub_(sign * h / length * gradient)
    return length, (values[0] - values[1]) / (2 * h)


@pytest.mark.parametrize("group", GROUPS)
def test_gradient_of_a_pixel_agrees_with_finite_differences(group):
    scene, settings = scene_with_structure(), SETTINGS
    if group in MOVES_DIRECTIONS:
        settings = dataclasses.replace(settings, neural=0.0, secondary_rays=4096)
    analytic, numeric = directional(scene, settings, GROUPS[group], STEP.get(group, 1e-2))
    assert numeric == pytest.approx(analytic, rel=0.03)


@pytest.mark.parametrize("group", ["albedo head", "F0 head", "g", "environment"])
def test_gradient_through_retraced_rays_agrees_with_finite_differences(group):
    scene = scene_with_structure()
    settings = dataclasses.replace(
        SETTINGS, secondary_rays=32, retraced_rays=1 << 20, secondary_bounce_rays=8, step=1.0,
        secondary_step=1.0,
    )  # fmt: skip
    analytic, numeric = directional(scene, settings, GROUPS[group], STEP.get(group, 1e-2))
    assert numeric == pytest.approx(analytic, rel=0.03)


def test_gradients_of_both_twins_agree():
    names = [name for group in GROUPS.values() for name in group]

    def gradients():
        scene = scene_with_structure()
        parameters = [scene.get_parameter(name) for name in names]
        return torch.autograd.grad(brightness(scene, SETTINGS), parameters)

    fused = gradients()
    with plain_torch():
        plain = gradients()
    for name, a, b in zip(names, fused, plain, strict=True):
        error = float((a - b).norm() / b.norm().clamp(min=1e-6))
        assert error < 0.01, name
