"""A fitted scene as the asset sees it."""

import numpy as np
import torch

from solver.asset.from_scene import SceneSurface, surface_level
from solver.asset.surface import marching_cubes
from solver.capture.camera import Camera
from solver.render.scene import RenderSettings
from tests.capture.test_capture import pose
from tests.render.scenes import ball


def cameras():
    return [Camera(f"c{i}", None, pose(i), 64, 64, 110.0, 110.0, 32.0, 32.0) for i in range(6)]


def test_density_that_no_ray_ever_meets_does_not_reach_the_mesh():
    """A fixed bug: what the masks exclude is never seen, so nothing keeps the fit from filling it."""
    scene = ball(radius=0.9, sharpness=400.0)
    ticks = (torch.arange(32) + 0.5) / 16 - 1
    grid = torch.stack(torch.meshgrid(ticks, ticks, ticks, indexing="ij"), -1)
    scene.occupancy.allow_only(grid.norm(dim=-1) < 0.4, dilation=0)
    mesh = marching_cubes(SceneSurface(scene), 48, 20.0)
    assert np.abs(mesh.vertices).max() < 0.55


def test_the_mesh_has_the_silhouette_that_rays_see():
    scene = ball(radius=0.5, sharpness=400.0)
    level = surface_level(scene, RenderSettings(), cameras())
    mesh = marching_cubes(SceneSurface(scene), 64, level)
    radius = np.linalg.norm(mesh.vertices, axis=1).mean()
    from solver.asset.from_scene import ray_peaks

    offsets = torch.linspace(0.3, 0.7, 400)
    origins = torch.stack([offsets, torch.zeros(400), torch.full((400,), 3.0)], -1)
    directions = torch.tensor([0.0, 0.0, -1.0]).expand(400, 3).contiguous()
    opacity, _ = ray_peaks(scene, RenderSettings(), origins, directions)
    seen = offsets[np.flatnonzero(opacity > 0.5)[-1]]
    assert abs(radius - float(seen)) < 0.01
