"""A light of which a part is close by, as one that is all far away."""

import pytest
import torch

from solver.asset.far_light import COARSE, Mirrors, light_from_afar, mean_from, mirrors_of
from solver.light.floor import Floor
from tests.capture.poses import ring
from tests.light.floors import striped
from tests.render.scenes import ball

FLOOR = Floor((0.0, 0.0, 1.0), -0.6, (0.2, 0.0, 0.1))


def light_on(floor):
    light = striped(FLOOR, 64, sky=0.5)
    light.floor = floor
    return light


def cameras(height=1.44):
    return ring(8, (height,))


def test_a_light_that_is_far_stays_as_it_is():
    scene = ball(environment=light_on(None))
    assert light_from_afar(scene, cameras()) is scene.environment


def test_seen_from_its_centre_the_light_stays_as_it_is():
    light = light_on(FLOOR)
    centre = torch.tensor([FLOOR.centre] * 3)
    found = mean_from(light, FLOOR, Mirrors(centre, torch.rand(3, COARSE, 2 * COARSE) + 0.1))
    torch.testing.assert_close(found.radiance(), light.radiance(), rtol=1e-4, atol=1e-4)
    assert found.floor is None


def test_seen_from_one_point_it_is_what_that_point_sees():
    light, point = light_on(FLOOR), torch.tensor([[-0.3, 0.2, 0.2]])
    found = mean_from(light, FLOOR, Mirrors(point, torch.ones(1, COARSE, 2 * COARSE)))
    down = torch.nn.functional.normalize(torch.tensor([[0.3, 0.1, -1.0], [-0.5, 0.4, -0.9]]), dim=-1)
    there, sharp = point.expand(2, 3), torch.zeros(2)
    expected = light.lookup(light.tables(), down, sharp, points=there)
    torch.testing.assert_close(found.lookup(found.tables(), down, sharp), expected, rtol=0.03, atol=0.02)


def test_a_ball_mirrors_what_is_low_with_its_sides_and_what_is_high_with_its_top():
    scene = ball(environment=light_on(FLOOR), sharpness=2000.0)
    mirrors = mirrors_of(scene, cameras())
    weights = mirrors.weights.flatten(1)
    assert (mirrors.points.norm(dim=-1) - 0.5).abs().max() < 0.3
    height = (weights * mirrors.points[:, 2:]).sum(0) / weights.sum(0)
    low, high = height.view(COARSE, -1)[[-6, 3]].mean(1)
    # Half way between a camera 26° up and straight down a normal is 32° below the horizon, and sees none.
    assert -0.3 < low < 0.1 < 0.3 < high


@pytest.mark.parametrize("nobody", [[], cameras(height=0.0)], ids=["no cameras", "level ones"])
def test_where_nothing_is_mirrored_the_light_is_there_too(nobody):
    scene = ball(environment=light_on(FLOOR))
    found = light_from_afar(scene, nobody).radiance().detach()
    assert torch.isfinite(found).all() and 0.2 < float(found.min()) and float(found.max()) < 1.8
