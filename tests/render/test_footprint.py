"""What a pixel's width does to reflections."""

import math

import numpy as np
import pytest
import torch

from solver.brdf.microfacet import tangent_frame
from solver.capture.frames import direction_from_equirect
from solver.light.environment import EnvironmentMap
from solver.render.composition import Composition, Placement
from solver.render.footprint import reflected_spread
from solver.render.image import image_settings
from solver.render.radiance import render_rays
from solver.render.random_numbers import RandomNumbers
from solver.render.scene import RenderSettings, Samples, StepTables
from tests.render.scenes import ball

RADIUS, PIXEL = 0.5, 0.001


def on_ball(directions, origin=(0.0, 0.0, 3.0)):
    """Where rays from `origin` meet the ball, at what distance, and where its mirror sends them."""
    origin = torch.tensor(origin).expand_as(directions)
    half = (origin * directions).sum(-1, keepdim=True)
    distance = -half - (half**2 - (origin**2).sum(-1, keepdim=True) + RADIUS**2).sqrt()
    points = origin + distance * directions
    normals = points / RADIUS
    mirrored = directions - 2 * (directions * normals).sum(-1, keepdim=True) * normals
    return points, distance[:, 0], normals, mirrored


def toward_ball(count=40, extent=0.12):
    torch.manual_seed(1)
    aside = extent * (2 * torch.rand(count, 2) - 1)
    return torch.nn.functional.normalize(torch.cat([aside, -torch.ones(count, 1)], -1), dim=-1)


def test_spread_is_the_change_of_mirrored_rays_across_a_pixel_of_a_ball():
    scene, directions = ball(RADIUS), toward_ball()
    points, distance, normals, mirrored = on_ball(directions)
    index = torch.arange(len(points))
    samples = Samples(points, distance, index, index)
    spread = reflected_spread(
        scene,
        StepTables.of(scene),
        samples,
        normals,
        -directions,
        torch.full((len(points),), PIXEL),
    )
    for row, edge in enumerate(tangent_frame(-directions)):
        aside = torch.nn.functional.normalize(directions + PIXEL * edge, dim=-1)
        exact = on_ball(aside)[3] - mirrored
        assert (spread[:, row] - exact).norm(dim=-1).max() < 0.02 * exact.norm(dim=-1).max()


def test_spread_of_a_placed_scene_turns_with_it():
    scene, directions = ball(RADIUS), toward_ball()
    points, distance, normals, _ = on_ball(directions)
    index = torch.arange(len(points))
    placement = Placement((0.3, -0.2, 0.1), 2.0, 0.7)
    turn = placement.rotation("cpu")
    placed = Composition([scene], [placement], scene.environment)
    moved = 2.0 * points @ turn.T + torch.tensor(placement.position)
    part = torch.zeros(len(points), dtype=torch.long)
    angle = torch.full((len(points),), PIXEL)
    here = reflected_spread(
        scene, StepTables.of(scene), Samples(points, distance, index, index), normals, -directions, angle
    )
    there = reflected_spread(
        placed, StepTables.of(placed),
        Samples(moved, 2 * distance, index, index, part),
        normals @ turn.T, -directions @ turn.T, angle,
    )  # fmt: skip

    def gram(edges):
        # The pixel's edges may be chosen otherwise there; what they span may not.
        return torch.einsum("nei,nej->nij", edges, edges)

    expected = turn @ gram(here) @ turn.T
    torch.testing.assert_close(gram(there), expected, atol=1e-2 * float(expected.abs().max()), rtol=0)


def test_a_blurred_lookup_has_the_variance_of_square_and_parallelogram():
    light = EnvironmentMap(64, 1.0)
    direction = torch.tensor([[1.0, 0.0, 0.0], [math.cos(0.8), 0.0, math.sin(0.8)]])
    east = torch.tensor([0.0, 1.0, 0.0])
    south = torch.stack([torch.tensor([0.0, 0.0, -1.0]),
                         torch.tensor([math.sin(0.8), 0.0, -math.cos(0.8)])])  # fmt: skip
    spread = torch.stack([0.3 * east.expand(2, 3), 0.4 * south], dim=1)
    both = light._variance(direction, torch.full((2,), 0.25), spread, None)
    torch.testing.assert_close(both, torch.tensor([[0.34, 0.41]]).expand(2, 2))
    rows = torch.tensor([32.0, 32.0])
    size = light.footprint(rows, both)
    radians = size * torch.tensor([2 * math.pi / 128, math.pi / 64])
    torch.testing.assert_close(radians, torch.tensor([[0.34, 0.41]]).sqrt().expand(2, 2))


@pytest.fixture(scope="module")
def striped():
    """A mirror ball under a light of narrow stripes, and its pixels averaged over many rays."""
    u, v = np.meshgrid((np.arange(128) + 0.5) / 128, (np.arange(64) + 0.5) / 64)
    sky = direction_from_equirect(np.stack([u, v], -1))
    value = 1 + np.sin(14 * sky[..., 0]) * np.cos(11 * sky[..., 1])
    light = EnvironmentMap.from_radiance(torch.from_numpy(value)[..., None].expand(-1, -1, 3))
    scene = ball(RADIUS, environment=light, albedo=0.01, roughness=0.03, f0=0.9, sharpness=4000.0)
    return scene, toward_ball(60)


def shown(scene, directions, pixel_footprint=True, angle=None):
    settings = image_settings(
        RenderSettings(neural=0.0, retraced_rays=0, pixel_footprint=pixel_footprint), 64
    )
    count = len(directions)
    angles = None if angle is None else torch.full((count,), angle)
    origins = torch.tensor([0.0, 0.0, 3.0]).expand(count, 3).contiguous()
    with torch.no_grad():
        return render_rays(
            scene, StepTables.of(scene), settings, RandomNumbers(0), origins, directions,
            torch.arange(count), jitter=False, pixel_angle=angles,
        ).radiance  # fmt: skip


def test_one_wide_ray_shows_what_many_rays_through_the_pixel_average_to(striped):
    scene, directions = striped
    angle, many = 0.02, 12
    first, second = tangent_frame(-directions)
    ticks = (np.arange(many) + 0.5) / many - 0.5
    total = 0
    for a in ticks:
        for b in ticks:
            ray = torch.nn.functional.normalize(
                directions + angle * (float(a) * first + float(b) * second), dim=-1
            )
            total = total + shown(scene, ray)
    average = total / many**2

    def error(picture):
        return float((picture - average).square().mean().sqrt())

    narrow, wide = error(shown(scene, directions)), error(shown(scene, directions, angle=angle))
    assert wide < 0.4 * narrow
    off = shown(scene, directions, pixel_footprint=False, angle=angle)
    torch.testing.assert_close(off, shown(scene, directions))
