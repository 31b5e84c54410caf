"""Fused glossy reflection: every path against its plain twin."""

import dataclasses

import pytest
import torch
from scipy.spatial.transform import Rotation

from solver.kernels.backend import forced_path
from solver.kernels.skipping import blocking_grid
from solver.kernels.specular import specular
from solver.light.environment import EnvironmentMap, equirect_directions
from solver.light.floor import Floor
from solver.render.random_numbers import RandomNumbers
from solver.render.reflection import reflected
from solver.render.scene import RenderSettings, Samples, StepTables, Surface
from tests.kernels.paths import PATHS
from tests.render.test_invariance import lumpy

COUNT, RAYS = 60, 400
SETTINGS = RenderSettings(neural=0.0, retraced_rays=0)


def inputs(device):
    """Surfaces of all kinds, some seen edge on, some facing a pole; one weighs nothing."""
    generator = torch.Generator().manual_seed(5)

    def rand(*shape):
        return torch.rand(*shape, generator=generator)

    normals = torch.nn.functional.normalize(rand(COUNT, 3) - 0.5, dim=-1)
    normals[0], normals[1] = torch.tensor([0.0, 0.0, 1.0]), torch.tensor([0.0, 0.0, -1.0])
    view = torch.nn.functional.normalize(normals + 0.9 * (2 * rand(COUNT, 3) - 1), dim=-1)
    view[:2] = normals[:2]
    view = torch.where((view * normals).sum(-1, keepdim=True) > 0, view, -view)
    mass = rand(COUNT) / COUNT
    mass[5] = 0.0
    alpha, f0 = 0.002 + 0.6 * rand(COUNT), rand(COUNT, 3)
    points = 0.6 * normals + 0.05 * rand(COUNT, 3)
    spread = 0.05 * (rand(COUNT, 2, 3) - 0.5)
    values = normals, view, mass, alpha, f0, points, spread
    return [value.to(device) for value in values]


def mirrored_sky(origins, directions, keys, start):
    """Stands for a trace: what rays meet depends on where they go, as with a gradient it does."""
    return 1 + directions * directions.roll(1, -1), torch.full_like(start, 0.3)


def shaded(path, device, settings, floor=False, trace=None, axes=None):
    """Radiance, and gradients to normals, α, F0 and the light, on a path of a device."""
    scene = lumpy(axes=axes).to(device)
    # Half-clear things all around, so that rays are dimmed, and some can be traced further.
    depths = 0.5 * torch.rand(scene.occupancy.blocking.shape, generator=torch.Generator().manual_seed(1))
    scene.occupancy.blocking = blocking_grid(depths * (depths > 0.4)).to(device)
    scene.environment = EnvironmentMap.from_radiance(
        0.2 + (2 * equirect_directions(32, 64).float()).exp()
    ).to(device)
    if floor:
        scene.environment.floor = Floor((0.0, 0.0, 1.0), -0.7, (0.0, 0.0, 0.0))
    normals, view, mass, alpha, f0, points, spread = inputs(device)
    normals, alpha, f0 = (value.requires_grad_() for value in (normals, alpha, f0))
    nothing = torch.zeros(COUNT, device=device)
    keys = torch.arange(COUNT, device=device) * 4096
    samples = Samples(points, nothing, nothing.long(), keys)
    with forced_path(path):
        tables = StepTables.of(scene)
        surface = scene.surface(points, None, tables.normals)
        materials = surface.materials._replace(alpha=alpha, f0=f0)
        surface = Surface(normals, surface.features, materials, surface.reach)
        radiance = reflected(
            scene, tables, settings, RandomNumbers(0, device), samples, surface, normals, view, mass,
            RAYS, trace, spread,
        )  # fmt: skip
        cotangent = torch.linspace(0.5, 1.5, 3 * COUNT, device=device).view(COUNT, 3)
        radiance.backward(cotangent)
    light = scene.environment.log_radiance.grad
    return radiance.detach(), normals.grad, alpha.grad, f0.grad, light


@pytest.mark.parametrize("path, device", PATHS)
@pytest.mark.parametrize(
    "masking, averaged, widening, floor",
    [
        (True, True, True, False), (False, False, False, False), (False, False, True, False),
        (True, True, False, True), (True, True, True, True),
    ],
)  # fmt: skip
def test_kernels_agree_with_their_twin_in_values_and_gradients(
    path, device, masking, averaged, widening, floor
):
    settings = dataclasses.replace(
        SETTINGS, light_masking=masking, integral_image=averaged, widening_gradient=widening
    )
    ours = shaded(path, device, settings, floor)
    theirs = shaded("torch", device, settings, floor)
    assert theirs[0].max() > 0.5 and (theirs[0][5] == 0).all()
    for name, a, b in zip(("radiance", "normals", "alpha", "f0", "light"), ours, theirs, strict=True):
        scale = float(b.abs().mean())
        assert scale > 0 and torch.isfinite(a).all(), name
        torch.testing.assert_close(
            a, b, rtol=5e-3, atol=5e-3 * scale, msg=lambda m, name=name: f"{name}: {m}"
        )


@pytest.mark.parametrize("path, device", PATHS)
def test_kernels_agree_with_their_twin_where_the_box_is_turned(path, device):
    axes = torch.tensor(Rotation.from_rotvec([0.5, -0.7, 1.1]).as_matrix())
    ours = shaded(path, device, SETTINGS, axes=axes)
    theirs = shaded("torch", device, SETTINGS, axes=axes)
    straight = shaded("torch", device, SETTINGS)
    assert (theirs[0] - straight[0]).abs().max() > 0.1
    for name, a, b in zip(("radiance", "normals", "alpha", "f0"), ours, theirs, strict=False):
        scale = float(b.abs().mean())
        torch.testing.assert_close(a, b, rtol=5e-3, atol=5e-3 * scale, msg=lambda m, n=name: f"{n}: {m}")


@pytest.mark.parametrize("path, device", PATHS)
def test_gradients_of_what_is_traced_further_come_through_directions_and_weights(path, device):
    # A budget for all that are blocked, so that chance decides nothing.
    settings = dataclasses.replace(SETTINGS, retraced_rays=10 * RAYS)
    ours = shaded(path, device, settings, trace=mirrored_sky)
    theirs = shaded("torch", device, settings, trace=mirrored_sky)
    alone = shaded("torch", device, SETTINGS)
    assert (theirs[0] - alone[0]).abs().max() > 0.1 and (theirs[1] - alone[1]).abs().max() > 0.1
    for name, a, b in zip(("radiance", "normals", "alpha", "f0"), ours, theirs, strict=False):
        scale = float(b.abs().mean())
        torch.testing.assert_close(a, b, rtol=5e-3, atol=5e-3 * scale, msg=lambda m, n=name: f"{n}: {m}")


def test_rays_of_other_samples_are_refused():
    normals, view, mass, alpha, f0, points, _ = inputs("cpu")
    blockers = lumpy().blockers(0.1)
    with pytest.raises(ValueError, match="61 numbers wanted, 60 given"):
        specular(
            normals, alpha, f0, torch.zeros(3, 5, 3, dtype=torch.float64), view, points,
            torch.ones(COUNT).long(), mass, torch.ones(COUNT).long(), torch.rand(COUNT, 2),
            torch.zeros(3), True, True, True, blockers,
        )  # fmt: skip
