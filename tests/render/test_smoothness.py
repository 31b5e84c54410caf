"""How unlike its surroundings a surface is."""

import math

import pytest
import torch
import torch.nn.functional as F

from solver.field.heads import Materials
from solver.render.radiance import render_rays
from solver.render.random_numbers import RandomNumbers
from solver.render.scene import RenderSettings, StepTables
from solver.render.smoothness import (
    CREASE,
    EVEN_F0,
    EVEN_ROUGHNESS,
    GLOSS_ROUGHNESS,
    bending,
    saturating,
    unevenness,
)
from tests.render.scenes import ball, camera_rays, fill_everywhere

SETTINGS = RenderSettings(
    neural=0.0, secondary_rays=8, retraced_rays=0, visibility=False, neighbour_distance=0.3
)


def unit(*rows):
    return F.normalize(torch.tensor(rows, dtype=torch.float64), dim=-1)


def turned(angle):
    """A normal turned from +z by `angle`, rad."""
    return unit([math.sin(angle), 0.0, math.cos(angle)])


@torch.no_grad()
def seen_bending(scene):
    """What rays towards a ball see of its bending."""
    origins, directions = camera_rays(8, extent=0.3)
    keys = torch.arange(len(origins))
    return render_rays(
        scene, StepTables.of(scene), SETTINGS, RandomNumbers(0), origins, directions, keys, False
    ).bending.sum()


def test_flat_and_evenly_round_surfaces_do_not_bend_unevenly():
    flat = turned(0.3)
    assert float(bending(flat, flat, flat)) == 0
    for angle in (0.02, 0.1):
        # What evenly round surfaces keep is of the fourth order: their normals turn, and nothing else.
        kept = float(bending(turned(0.0), turned(angle), turned(-angle))) * CREASE**2
        assert kept < 1.1 * (angle**2 / 2) ** 2


@pytest.mark.parametrize("degrees", [0.5, 2.0, 5.0])
def test_a_lone_normal_counts_by_the_square_of_its_angle(degrees):
    angle = math.radians(degrees)
    found = float(bending(turned(angle), turned(0.0), turned(0.0)))
    assert found == pytest.approx(angle**2 / (angle**2 + CREASE**2), rel=2e-3)


def test_edges_are_left_alone_and_wobbles_are_not():
    def pull(angle):
        angle = torch.tensor(angle, dtype=torch.float64, requires_grad=True)
        here = torch.stack([angle.sin(), torch.zeros_like(angle), angle.cos()])[None]
        bending(here, turned(0.0), turned(0.0)).sum().backward()
        return float(angle.grad)

    assert pull(math.radians(2)) > 50 * pull(math.radians(45))
    assert float(bending(turned(math.pi), turned(0.0), turned(0.0))) < 1


def test_bending_has_the_gradient_of_its_differences():
    torch.manual_seed(0)
    normals = [F.normalize(torch.randn(6, 3, dtype=torch.float64), dim=-1).requires_grad_() for _ in "123"]
    assert torch.autograd.gradcheck(bending, normals)


def test_saturating_is_a_half_at_its_spread_and_never_more_than_one():
    x = torch.tensor([0.0, 0.3, 1e6])
    found = saturating(x.square(), 0.3).tolist()
    assert found[:2] == [0.0, pytest.approx(0.5)] and 0.999 < found[2] <= 1


def dented(roughness, depth):
    """A glossy ball whose density is uneven."""
    scene = ball(roughness=roughness)
    planes = scene.field.density_planes
    noise = torch.randn(planes.shape, generator=torch.Generator().manual_seed(1))
    with torch.no_grad():
        planes.add_(depth * noise)
    fill_everywhere(scene)
    return scene


def test_dents_of_a_ball_are_seen_and_its_roundness_is_not():
    round_, wobbly = (float(seen_bending(dented(0.05, depth))) for depth in (0.0, 2.0))
    assert wobbly > 10 * round_


def test_rough_surfaces_may_bend_as_the_photos_say():
    sharp, rough = (float(seen_bending(dented(r, 2.0))) for r in (0.2, 0.5))
    assert rough / sharp == pytest.approx(math.exp(-0.3 / GLOSS_ROUGHNESS), rel=1e-3)


def material(albedo=0.5, roughness=0.3, f0=0.04):
    rows = torch.full((1, 3), albedo), torch.full((1,), roughness**2), torch.full((1, 3), f0)
    return Materials(*(values.requires_grad_() for values in rows))


@torch.no_grad()
def test_a_step_of_roughness_counts_most_within_one_colour():
    here, step = material(), 0.1
    assert float(unevenness(here, material())) == 0
    within = float(unevenness(here, material(roughness=0.3 + step)))
    assert within == pytest.approx(EVEN_ROUGHNESS * step, rel=1e-4)
    for other, apart in (({"albedo": 0.9}, 0.4), ({"f0": 0.6}, EVEN_F0 * 0.56)):
        alone = float(unevenness(here, material(**other)))
        assert alone == pytest.approx(apart, rel=1e-4)
        across = float(unevenness(here, material(roughness=0.3 + step, **other)))
        assert step <= across - alone < 1.01 * step


def test_colours_are_not_moved_apart_to_let_roughness_step():
    here, near = material(albedo=0.5), material(albedo=0.51, roughness=0.6)
    unevenness(here, near).sum().backward()
    alone = material(albedo=0.5)
    unevenness(alone, material(albedo=0.51)).sum().backward()
    torch.testing.assert_close(here.albedo.grad, alone.albedo.grad)
    assert float(near.alpha.grad) > 0
