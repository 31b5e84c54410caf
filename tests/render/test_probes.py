"""Probes of diffuse light: against rays by brute force, in furnaces, between several scenes."""

import math

import pytest
import torch

from solver.field.occupancy import Occupancy
from solver.kernels.skipping import of_corners
from solver.light.environment import EnvironmentMap, equirect_directions
from solver.light.irradiance import irradiance
from solver.render.composition import Composition, Placement
from solver.render.probes import MOST_PROBES, nodes_of
from solver.render.probing import refresh_probes
from solver.render.scene import StepTables
from tests.render.scenes import ball

BLACK, WHITE = -20.0, 20.0  # before the sigmoid


def scene_of(distance, cells=96, environment=None, albedo=BLACK):
    """A scene whose occupancy grid holds what a signed distance says, reflecting nothing but albedo."""
    scene = ball(environment=environment)
    scene.occupancy = Occupancy(cells)
    ticks = torch.linspace(-1, 1, cells + 1)
    depth = distance(torch.stack(torch.meshgrid(ticks, ticks, ticks, indexing="ij"), -1))
    depth = 6 * torch.sigmoid(-2.5 * depth / scene.cell) * (depth < 2 * scene.cell)
    scene.occupancy.fill(of_corners(depth > 0, torch.logical_or), depth)
    with torch.no_grad():
        scene.field.heads.albedo.bias.fill_(albedo)
        scene.field.heads.f0.bias.fill_(BLACK)
    return scene


def globe(points):
    return points.norm(dim=-1) - 0.55


def two_globes_on_a_slab(points):
    first = (points - torch.tensor([0.0, 0.0, 0.1])).norm(dim=-1) - 0.35
    second = (points - torch.tensor([0.5, 0.3, -0.1])).norm(dim=-1) - 0.25
    slab = torch.maximum((points[..., 2] + 0.4).abs() - 0.08, points[..., :2].abs().amax(-1) - 0.85)
    return torch.minimum(torch.minimum(first, second), slab)


def globe_on_a_slab(points):
    globe = (points - torch.tensor([0.0, 0.0, 0.1])).norm(dim=-1) - 0.4
    slab = torch.maximum((points[..., 2] + 0.4).abs() - 0.1, points[..., :2].abs().amax(-1) - 0.85)
    return torch.minimum(globe, slab)


def surface_of(distance, count):
    """Points on a surface and their normals."""
    torch.manual_seed(1)
    points = torch.rand(60_000, 3) * 1.8 - 0.9
    points = points[distance(points).abs() < 0.05][: 4 * count]
    for _ in range(20):
        slopes = [distance(points + 1e-3 * e) - distance(points - 1e-3 * e) for e in torch.eye(3)]
        normals = torch.nn.functional.normalize(torch.stack(slopes, -1), dim=-1)
        points = points - distance(points)[:, None] * normals
    good = distance(points).abs() < 1e-3
    return points[good][:count], normals[good][:count]


def light_from_above():
    directions = equirect_directions(64, 128)
    bright = 0.3 + 2 * directions[..., 2:].clamp(min=0) ** 3
    return EnvironmentMap.from_radiance(bright * torch.tensor([1.0, 0.9, 0.7]))


def by_brute_force(distance, light, points, normals, count=2000):
    """Irradiance [S, 3]: rays through the exact shapes, black ones."""
    torch.manual_seed(0)
    tables, result = light.tables(), []
    for point, normal in zip(points, normals, strict=True):
        rays = torch.nn.functional.normalize(torch.randn(count, 3), dim=-1)
        rays = rays * torch.sign(rays @ normal)[:, None]
        t, free = torch.full((count,), 0.01), torch.ones(count)
        for _ in range(60):
            ahead = distance(point + t[:, None] * rays)
            free[ahead < 1e-3] = 0
            t = t + ahead.clamp(min=2e-3)
        seen = light.lookup(tables, rays, torch.zeros(count))
        result.append((seen * ((rays @ normal) * free)[:, None]).mean(0) * 2 * math.pi)
    return torch.stack(result).detach()


def probed(scene, points, normals):
    with torch.no_grad():
        return scene.irradiance(points, None, normals, StepTables.of(scene).light)


def test_shaded_light_agrees_with_brute_force():
    light = light_from_above()
    scene = scene_of(two_globes_on_a_slab, environment=light)
    points, normals = surface_of(two_globes_on_a_slab, 150)
    expected = by_brute_force(two_globes_on_a_slab, light, points, normals)
    unaware = irradiance(StepTables.of(scene).light.irradiance[0], normals).detach()
    refresh_probes(scene)
    error = (probed(scene, points, normals) - expected).abs()
    scale = float(expected.mean())
    assert float(error.mean()) < 0.08 * scale and float(error.quantile(0.9)) < 0.2 * scale
    assert float(error.mean()) < 0.3 * float((unaware - expected).abs().mean())


def test_in_the_crevice_below_a_globe_it_is_dark():
    light = EnvironmentMap.from_radiance(torch.ones(64, 128, 3))
    scene = scene_of(globe_on_a_slab, environment=light)
    around = torch.linspace(0, 2 * math.pi, 25)[:-1]
    circle = torch.stack([around.cos(), around.sin()], -1)
    points = torch.cat([torch.nn.functional.pad(r * circle, (0, 1), value=-0.3) for r in (0.1, 0.15)])
    normals = torch.tensor([[0.0, 0.0, 1.0]]).expand(len(points), 3)
    expected = by_brute_force(globe_on_a_slab, light, points[::12], normals[::12])
    refresh_probes(scene)
    found = probed(scene, points, normals)
    assert float(expected.max()) < 0.2 * math.pi
    assert float((found[::12] - expected).abs().mean()) < 0.1 * math.pi
    assert float(found.max()) < 0.25 * math.pi


def test_a_convex_body_sees_all_light():
    scene = scene_of(globe)
    points, normals = surface_of(globe, 200)
    refresh_probes(scene)
    found = probed(scene, points, normals)
    torch.testing.assert_close(found, torch.full_like(found, math.pi), rtol=0.05, atol=0)


def test_in_a_furnace_white_blockers_make_up_for_most_of_what_they_hide():
    points, normals = surface_of(two_globes_on_a_slab, 150)
    means = []
    for albedo in (BLACK, WHITE):
        scene = scene_of(two_globes_on_a_slab, albedo=albedo)
        refresh_probes(scene)
        found = probed(scene, points, normals)
        assert float(found.max()) < 1.08 * math.pi
        means.append(float(found.mean()))
    assert means[1] > 0.5 * (means[0] + math.pi) and means[1] < 1.03 * math.pi


def with_f0(scene, value):
    with torch.no_grad():
        scene.field.heads.f0.bias.fill_(value)
    return scene


def test_in_a_furnace_mirrors_send_as_much_as_white_blockers():
    points, normals = surface_of(two_globes_on_a_slab, 150)
    found = []
    for albedo, f0 in ((WHITE, BLACK), (BLACK, WHITE), (WHITE, WHITE)):
        scene = with_f0(scene_of(two_globes_on_a_slab, albedo=albedo), f0)
        refresh_probes(scene)
        found.append(probed(scene, points, normals))
    assert float(found[1].max()) < 1.08 * math.pi
    assert float(found[1].mean()) == pytest.approx(float(found[0].mean()), rel=0.03)
    torch.testing.assert_close(found[2], found[1], rtol=1e-4, atol=1e-4)


def test_before_probes_look_around_all_light_arrives():
    scene = scene_of(globe, environment=light_from_above())
    normals = torch.nn.functional.normalize(torch.randn(20, 3), dim=-1)
    light = StepTables.of(scene).light
    torch.testing.assert_close(
        scene.irradiance(0.55 * normals, None, normals, light),
        irradiance(light.irradiance[0], normals),
    )


def test_an_empty_scene_has_no_probes_and_all_light():
    scene = scene_of(lambda points: points.norm(dim=-1) + 1)
    refresh_probes(scene)
    assert len(scene.probes.arriving.passing) == 0
    points, normals = surface_of(globe, 20)
    found = probed(scene, points, normals)
    torch.testing.assert_close(found, torch.full_like(found, math.pi), rtol=2e-3, atol=0)


def test_many_surfaces_have_fewer_probes_further_apart():
    torch.manual_seed(0)
    depths = (torch.rand(128, 128, 128) < 0.02).float()
    nodes, points = nodes_of(depths, 1)
    assert 0 < len(points) <= MOST_PROBES and int(nodes.row.max()) == len(points)
    assert nodes.spacing > 3 / 128


def test_gradients_to_the_light_pass_through_the_probes():
    scene = scene_of(two_globes_on_a_slab, environment=light_from_above())
    refresh_probes(scene)
    points, normals = surface_of(two_globes_on_a_slab, 30)

    def value():
        return scene.irradiance(points, None, normals, StepTables.of(scene).light).sum()

    value().backward()
    parameter = scene.environment.log_radiance
    torch.manual_seed(3)
    step = torch.rand_like(parameter)
    predicted = float((parameter.grad * step).sum())
    ends = []
    with torch.no_grad():
        for sign in (1, -1):
            parameter += sign * 1e-3 * step
            ends.append(float(value()))
            parameter -= sign * 1e-3 * step
    assert math.isclose((ends[0] - ends[1]) / 2e-3, predicted, rel_tol=5e-3)


def test_a_turned_and_scaled_part_sees_the_light_of_the_world():
    light, placement = light_from_above(), Placement((0.3, -0.2, 0.1), 1.7, math.pi / 2)
    alone = scene_of(two_globes_on_a_slab, environment=light)
    refresh_probes(alone)
    points, normals = surface_of(two_globes_on_a_slab, 60)
    expected = probed(alone, points, normals)
    world = Composition([scene_of(two_globes_on_a_slab)], [placement], light)
    refresh_probes(world)
    rotation = placement.rotation("cpu")
    placed = placement.scale * points @ rotation.T + torch.tensor(placement.position)
    with torch.no_grad():
        found = world.irradiance(
            placed,
            torch.zeros(60, dtype=torch.long),
            normals @ rotation.T,
            StepTables.of(world).light,
        )
    # The light is the same all around, so only the patches' borders differ.
    torch.testing.assert_close(found, expected, rtol=0.05, atol=0.05)


def test_parts_shade_each_other():
    light = EnvironmentMap(16, 1.0)
    parts = [scene_of(globe), scene_of(globe)]
    world = Composition(parts, [Placement(), Placement((0.0, 0.0, 1.15))], light)
    refresh_probes(world)
    top, side = torch.tensor([[0.0, 0.0, 0.55]]), torch.tensor([[0.55, 0.0, 0.0]])
    with torch.no_grad():
        found = world.irradiance(
            torch.cat([top, side]), torch.zeros(2, dtype=torch.long), torch.cat([top, side]) / 0.55,
            StepTables.of(world).light,
        )  # fmt: skip
    assert float(found[0, 0]) < 0.4 * math.pi < 0.85 * math.pi < float(found[1, 0])
