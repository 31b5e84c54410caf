"""Small scenes for tests."""

import torch

from solver.brdf.neural import NeuralTerm
from solver.field.field import MicrofacetField
from solver.light.environment import EnvironmentMap
from solver.render.scene import Scene

SIZE = 24


def ball(radius=0.5, environment=None, albedo=0.5, roughness=0.4, f0=0.1, sharpness=400.0, axes=None):
    """A ball at the origin in a box of half size 1, of one material, fitted by construction.

    `axes`: those of the box, with which all that is added to the ball turns.

    Raw density 12·(1 − |x|²/r²)·k is a sum of products: x² and y² in one plane, z² in another.
    """
    torch.manual_seed(0)
    field = MicrofacetField(
        torch.zeros(3), 1.0, SIZE, density_components=1, feature_components=2, feature_size=4,
        initial_albedo=albedo, initial_roughness=roughness, initial_f0=f0, axes=axes,
    )  # fmt: skip
    x = torch.linspace(-1, 1, SIZE)
    with torch.no_grad():
        field.density_planes.zero_()
        field.density_lines.fill_(1)
        scale = 0.1 * sharpness
        field.density_planes[0, :, :, 0] = scale * (radius**2 - x[:, None] ** 2 - x[None, :] ** 2)
        field.density_planes[1, :, :, 0] = -scale * (x[None, :] ** 2)
        for layer in (field.heads.albedo, field.heads.roughness, field.heads.f0):
            layer.weight.zero_()
    scene = Scene(field, environment or EnvironmentMap(16, 1.0), NeuralTerm(4, width=8), 32)
    refresh(scene)
    return scene


def refresh(scene):
    """Bring the occupancy up to the field."""
    scene.occupancy.refresh(scene.field, 0.01, scene.field.voxel, 1)


def fill_everywhere(scene):
    """Let marching look everywhere."""
    occupancy = scene.occupancy
    occupancy.fill(torch.ones_like(occupancy.occupied), occupancy.corner_depth)


def camera_rays(count=12, distance=3.0, extent=0.6):
    """Parallel-ish rays along −z towards the ball."""
    ticks = torch.linspace(-extent, extent, count)
    x, y = torch.meshgrid(ticks, ticks, indexing="ij")
    target = torch.stack([x, y, torch.zeros_like(x)], -1).reshape(-1, 3)
    origins = torch.tensor([0.0, 0.0, distance]).expand(len(target), 3)
    directions = torch.nn.functional.normalize(target - origins, dim=-1)
    return origins.contiguous(), directions
