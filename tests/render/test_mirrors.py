"""Light that metals throw onto what stands beside them, against rays by brute force."""

import math

import pytest
import torch
import torch.nn.functional as F

from solver.field.occupancy import Occupancy
from solver.light.environment import EnvironmentMap, equirect_directions
from solver.render import mirrors
from solver.render.composition import Composition, Placement
from solver.render.probing import refresh_probes
from solver.render.scene import StepTables
from tests.render.scenes import SIZE, ball

RADIUS, BESIDE, HALF = 0.4, torch.tensor([-0.75, 0.0, 0.0]), 0.06
DARK, BRIGHT = 1e-3, 0.999


def lamp_at(*direction):
    towards = F.normalize(torch.tensor(direction), dim=-1)
    near = torch.exp(-(((equirect_directions(64, 128).float() - towards).norm(dim=-1) / 0.3) ** 2))
    return EnvironmentMap.from_radiance(20 * near[..., None].expand(-1, -1, 3) + 0.02)


def with_fine_cells(part):
    part.occupancy = Occupancy(96)
    part.occupancy.refresh(part.field, 0.01, part.field.voxel, 1)
    return part


def wall(roughness):
    """A mirror across a box of half size 1, |x| < HALF."""
    scene = ball(albedo=DARK, roughness=roughness, f0=BRIGHT, sharpness=4000.0)
    planes, x = scene.field.density_planes, torch.linspace(-1, 1, SIZE)
    with torch.no_grad():
        planes.zero_()
        planes[0, :, :, 0] = 4000.0 * (HALF**2 - x[:, None] ** 2)
    return with_fine_cells(scene)


def beside_a_mirror(light, roughness=0.05):
    """A black ball beside a wall that mirrors."""
    black = with_fine_cells(ball(RADIUS, albedo=DARK, f0=DARK, sharpness=4000.0))
    placed = [Placement(), Placement(tuple(BESIDE.tolist()))]
    return Composition([wall(roughness), black], placed, light)


def meets_ball(origins, rays):
    """Whether rays meet the ball ahead of them."""
    away = origins - BESIDE
    half = (away * rays).sum(-1)
    inside = half**2 - (away * away).sum(-1) + RADIUS**2
    return (inside > 0) & (-half + inside.clamp(min=0).sqrt() > 1e-3)


def by_brute_force(light, points, normals, count=20_000):
    """Irradiance [S, 3] of points on the ball, and what of it is mirrored [S, 3]."""
    torch.manual_seed(0)
    whole, thrown, tables = [], [], light.tables()
    for point, normal in zip(points, normals, strict=True):
        rays = F.normalize(torch.randn(count, 3), dim=-1)
        rays = rays * torch.sign(rays @ normal)[:, None]
        distance = (-HALF - point[0]) / rays[:, 0].clamp(min=1e-6)
        hits = point + distance[:, None] * rays
        met = (rays[:, 0] > 0) & (hits[:, 1:].abs().amax(-1) < 1)
        bounced = rays * torch.tensor([-1.0, 1.0, 1.0])
        toward = torch.where(met[:, None], bounced, rays)
        seen = light.lookup(tables, toward, torch.zeros(count))
        seen = seen * ((rays @ normal) * ~(met & meets_ball(hits, bounced)))[:, None] * 2 * math.pi
        whole.append(seen.mean(0))
        thrown.append((seen * met[:, None]).mean(0))
    return torch.stack(whole).detach(), torch.stack(thrown).detach()


def facing_the_wall(polar=0.5, count=24):
    """Points on the ball's side towards the wall and their normals."""
    turn = torch.linspace(0, 2 * math.pi, count + 1)[:-1]
    level = math.sin(polar)
    normals = torch.stack(
        [torch.full_like(turn, math.cos(polar)), level * turn.cos(), level * turn.sin()], -1
    )
    return BESIDE + RADIUS * normals, normals


def irradiance_of(world, points, normals):
    refresh_probes(world)
    with torch.no_grad():
        part = torch.ones(len(points), dtype=torch.long)
        return world.irradiance(points, part, normals, StepTables.of(world).light)


def test_a_mirror_throws_a_lamp_onto_what_stands_beside_it(monkeypatch):
    light = lamp_at(-1.0, 0.9, 0.5)
    world = beside_a_mirror(light)
    points, normals = facing_the_wall()
    expected, thrown = by_brute_force(light, points, normals)
    assert float(thrown.mean()) > 0.5 * float(expected.mean())
    found = irradiance_of(world, points, normals)
    monkeypatch.setattr(mirrors, "MIRROR_F0", 2.0)
    as_if_diffuse = irradiance_of(world, points, normals)
    scale, error = float(expected.mean()), float((found - expected).abs().mean())
    assert error < 0.15 * scale
    assert error < 0.3 * float((as_if_diffuse - expected).abs().mean())
    assert float(found.mean()) == pytest.approx(scale, rel=0.1)


def test_a_rougher_metal_throws_softer_light():
    light = lamp_at(-1.0, 0.9, 0.5)
    points, normals = facing_the_wall()
    smooth, rough = (
        irradiance_of(beside_a_mirror(light, roughness), points, normals)[:, 0] for roughness in (0.05, 0.7)
    )
    assert float(rough.std() / rough.mean()) < 0.8 * float(smooth.std() / smooth.mean())


def test_what_stands_before_a_mirror_is_seen_in_it():
    light = EnvironmentMap.from_radiance(torch.ones(64, 128, 3))
    points, normals = facing_the_wall(0.2)
    found = []
    for bias in (-20.0, 20.0):  # before the sigmoid: black, white
        world = beside_a_mirror(light)
        with torch.no_grad():
            world.parts[1].field.heads.albedo.bias.fill_(bias)
        found.append(float(irradiance_of(world, points, normals).mean()))
    black, white = found
    assert black < 0.85 * math.pi and black + 0.4 * (math.pi - black) < white < 1.03 * math.pi
