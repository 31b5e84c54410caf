"""Diffuse light with blockers: against brute force, without noise where nothing blocks, in a furnace."""

import dataclasses

import torch

from solver.field.heads import Materials
from solver.light.environment import EnvironmentMap, equirect_directions
from solver.render.diffuse import cosine_rays, diffused
from solver.render.random_numbers import RandomNumbers
from solver.render.reflection import plan_rays
from solver.render.scene import RenderSettings, Samples, StepTables, Surface
from tests.render.scenes import ball

SETTINGS = RenderSettings(neural=0.0, diffuse_rays=512)


def setting(count=3):
    """Samples at the centre facing +Z; a coloured sky; a wall that hides a part of it."""
    sky = equirect_directions(32, 64).float()
    light = EnvironmentMap.from_radiance(1.3 + torch.stack(sky.unbind(-1), -1))
    scene = ball(environment=light)
    depths = torch.zeros_like(scene.occupancy.optical_depth)
    depths[20:, :, 14:] = 3.9
    scene.occupancy.fill(depths > 0, depths)
    normals = torch.tensor([0.0, 0.0, 1.0]).expand(count, 3).contiguous()
    samples = Samples(
        torch.zeros(count, 3), torch.ones(count), torch.arange(count), torch.arange(count)
    )  # fmt: skip
    material = Materials(torch.full((count, 3), 0.5), torch.ones(count), torch.zeros(count, 3))
    return scene, samples, Surface(normals, torch.zeros(count, 4), material, 0.05)


def radiance(scene, samples, surface, settings=SETTINGS, trace=None):
    albedo = surface.materials.albedo
    return diffused(
        scene, StepTables.of(scene), settings, RandomNumbers(1), samples, surface, albedo,
        torch.ones(len(albedo)), trace,
    )  # fmt: skip


def test_blocked_diffuse_light_agrees_with_brute_force():
    scene, samples, surface = setting()
    many = 40_000
    random = RandomNumbers(7, points=many)
    rays = cosine_rays(surface.normals, plan_rays(samples.keys, torch.ones(3), many, random))
    origins = samples.points[rays.sample] + 0.05 * surface.normals[rays.sample]
    cosine = (rays.direction * surface.normals[rays.sample]).sum(-1)
    start = torch.minimum(0.05 * (1 / cosine.clamp(min=0.2) - 1), torch.tensor(0.2))
    passing = scene.grid_transmittance(origins, rays.direction, start)
    assert 0.2 < passing.mean() < 0.8
    light = 1.3 + rays.direction
    expected = 0.5 * (passing[:, None] * light).view(3, many, 3).mean(1)
    torch.testing.assert_close(radiance(scene, samples, surface), expected, rtol=0.03, atol=0.01)


def test_what_blockers_send_replaces_the_light_they_hide():
    """In a furnace, blockers that glow like the sky change nothing."""
    scene, samples, surface = setting()
    scene.environment = EnvironmentMap(32, 1.0)

    def trace(origins, directions, keys, start):
        passing = scene.grid_transmittance(origins, directions, start)
        return (1 - passing)[:, None].expand(-1, 3), passing

    settings = dataclasses.replace(SETTINGS, diffuse_retraced_rays=1 << 30)
    seen = radiance(scene, samples, surface, settings, trace)
    torch.testing.assert_close(seen, torch.full((3, 3), 0.5), rtol=5e-3, atol=5e-3)


def test_few_traced_rays_are_right_in_the_mean():
    scene, samples, surface = setting(count=400)
    scene.environment = EnvironmentMap(32, 1.0)

    def trace(origins, directions, keys, start):
        passing = scene.grid_transmittance(origins, directions, start)
        return (1 - passing)[:, None].expand(-1, 3), passing

    settings = dataclasses.replace(SETTINGS, diffuse_rays=4, diffuse_retraced_rays=100)
    mean = radiance(scene, samples, surface, settings, trace).mean()
    assert abs(float(mean) - 0.5) < 0.03


def test_without_blockers_there_is_no_noise():
    scene, samples, surface = setting()
    scene.occupancy.fill(
        torch.zeros_like(scene.occupancy.occupied),
        torch.zeros_like(scene.occupancy.optical_depth),
    )
    few = radiance(scene, samples, surface, dataclasses.replace(SETTINGS, diffuse_rays=1))
    none = radiance(scene, samples, surface, dataclasses.replace(SETTINGS, diffuse_rays=0))
    assert torch.equal(few, none)
