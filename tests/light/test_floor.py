"""Light from close by: what rays see of a plane, as the centre of the light's map sees it."""

import math

import numpy as np
import pytest
import torch

from solver.brdf.microfacet import tangent_frame
from solver.light.floor import LOWEST, Floor
from tests.light.floors import striped, stripes

UP = torch.nn.functional.normalize(torch.tensor([0.2, -0.3, 0.9], dtype=torch.float64), dim=0)
FLOOR = Floor(tuple(UP.tolist()), -0.7, (0.1, 0.2, 0.3))


def rays(count=200, seed=0):
    """Points above the floor, and directions all round."""
    generator = torch.Generator().manual_seed(seed)
    points = torch.randn(count, 3, generator=generator, dtype=torch.float64)
    above = points @ UP - FLOOR.height
    points = points + (above.abs() - above + 0.2)[:, None] * UP
    directions = torch.randn(count, 3, generator=generator, dtype=torch.float64)
    return points, torch.nn.functional.normalize(directions, dim=-1)


def towards(floor, points, directions):
    return floor.seen(floor.shifts(points), directions).directions


def test_a_ray_that_meets_the_floor_sees_what_the_centre_sees_there():
    points, directions = rays()
    down = -(directions @ UP)
    met = points + directions * ((points @ UP - FLOOR.height) / down)[:, None]
    expected = torch.nn.functional.normalize(met - points.new_tensor(FLOOR.centre), dim=-1)
    found = towards(FLOOR, points, directions)
    assert (down > 0).sum() > 50
    torch.testing.assert_close(found[down > 0], expected[down > 0])


def test_what_goes_up_is_far_away_and_the_centre_sees_all_as_it_is():
    points, directions = rays()
    rising = directions @ UP >= 0
    torch.testing.assert_close(towards(FLOOR, points, directions)[rising], directions[rising])
    centre = points.new_tensor(FLOOR.centre).expand_as(points)
    torch.testing.assert_close(towards(FLOOR, centre, directions), directions)


def test_nothing_leaps_at_the_horizon():
    points, directions = rays()
    level = torch.nn.functional.normalize(directions - (directions @ UP)[:, None] * UP, dim=-1)
    for tilt in (1e-6, -1e-6):
        tilted = torch.nn.functional.normalize(level + tilt * UP, dim=-1)
        torch.testing.assert_close(towards(FLOOR, points, tilted), level, atol=1e-4, rtol=0)


def test_points_below_the_floor_count_as_right_above_it():
    below = torch.tensor([FLOOR.centre], dtype=torch.float64) - 5 * UP
    shift = FLOOR.shifts(below)
    assert torch.isfinite(shift).all()
    height = LOWEST * FLOOR.centre_height
    torch.testing.assert_close(shift, (below - below.new_tensor(FLOOR.centre)) / height)


def test_places_are_where_the_centre_sees_the_floor():
    _, directions = rays()
    places, on_floor = FLOOR.places(directions.numpy())
    up, centre = np.array(FLOOR.up), np.array(FLOOR.centre)
    np.testing.assert_allclose(places[on_floor] @ up, FLOOR.height, atol=1e-9)
    away = places[on_floor] - centre
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    np.testing.assert_allclose(away, directions.numpy()[on_floor], atol=1e-9)
    assert 50 < on_floor.sum() <= (directions @ UP < 0).sum()


def test_a_floor_counted_from_elsewhere_shows_the_same():
    points, directions = rays()
    origin = np.array([3.0, -2.0, 5.0])
    moved = FLOOR.counted_from(origin)
    there = points - torch.from_numpy(origin)
    torch.testing.assert_close(towards(moved, there, directions), towards(FLOOR, points, directions))


def test_turns_of_a_ray_move_its_place_as_finite_differences_say():
    points, directions = rays()
    shifts = FLOOR.shifts(points)
    seen = FLOOR.seen(shifts, directions)
    axes = torch.stack(tangent_frame(seen.directions), 1)
    across = torch.stack(tangent_frame(directions), 1)
    step = 1e-6
    for which in range(2):
        there, back = (
            FLOOR.seen(
                shifts, torch.nn.functional.normalize(directions + sign * across[:, which], dim=-1)
            ).directions
            for sign in (step, -step)
        )
        change = (there - back) / (2 * step)
        expected = torch.einsum("nij,nj->ni", axes, change)
        found = torch.einsum("nij,nj->ni", seen.along_rays(axes), across[:, which])
        torch.testing.assert_close(found, expected, atol=1e-6, rtol=1e-6)


@pytest.fixture(scope="module")
def light():
    return striped(FLOOR, 128)


def test_mirrors_anywhere_show_the_stripes_where_they_are(light):
    points, directions = (value.float() for value in rays())
    down = -(directions @ UP.float())
    met = points + directions * ((points @ UP.float() - FLOOR.height) / down)[:, None]
    from_centre = (met - met.new_tensor(FLOOR.centre)).norm(dim=-1)
    near = (down > 0.3) & (from_centre < 4 * FLOOR.centre_height)
    expected = torch.from_numpy(stripes(met.numpy()))[near]
    tables, sharp = light.tables(), torch.zeros(len(points))
    close, far = (
        light.lookup(tables, directions, sharp, points=where)[near, 0] for where in (points, None)
    )
    assert near.sum() > 30
    assert (close - expected).abs().mean() < 0.03 < 0.2 < (far - expected).abs().mean()


def test_gradients_to_directions_are_finite_differences():
    points, directions = rays(40)
    shifts = FLOOR.shifts(points)
    assert torch.autograd.gradcheck(lambda d: FLOOR.seen(shifts, d).directions, directions.requires_grad_())


def test_a_wide_look_at_the_floor_is_the_mean_of_what_its_rays_see(light):
    point = torch.tensor([[0.6, -0.2, 0.0]])
    down = -UP.float()
    first, second = tangent_frame(down[None])
    side, count = 0.5, 15
    ticks = (torch.arange(count) + 0.5) / count - 0.5
    a, b = torch.meshgrid(ticks, ticks, indexing="ij")
    fan = down + side * (a.reshape(-1, 1) * first + b.reshape(-1, 1) * second)
    fan = torch.nn.functional.normalize(fan, dim=-1)
    tables = light.tables()
    each = light.lookup(tables, fan, torch.zeros(len(fan)), points=point.expand(len(fan), 3))
    whole = light.lookup(tables, down[None], torch.tensor([side**2]), points=point)
    assert math.isclose(float(whole[0, 0].detach()), float(each[:, 0].mean().detach()), rel_tol=0.05)
