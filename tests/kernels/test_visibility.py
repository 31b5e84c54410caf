"""Looking around in a coarse grid: against its twin, the kernel for single rays and closed forms."""

import math

import pytest
import torch

from solver.kernels.backend import forced_path, plain_torch
from solver.kernels.march import grid_transmittance
from solver.kernels.skipping import blocking_grid
from solver.kernels.visibility import look_around
from tests.kernels.paths import PATHS, to_device


def directions(count=40):
    torch.manual_seed(1)
    return torch.nn.functional.normalize(torch.randn(count, 3), dim=-1)


def blobs(corners=25):
    torch.manual_seed(2)
    depths = torch.rand((corners,) * 3) * (torch.rand((corners,) * 3) < 0.05)
    return blocking_grid(4 * depths)


@pytest.mark.parametrize("path, device", PATHS)
def test_looking_around_agrees_with_its_twin(path, device):
    torch.manual_seed(0)
    points, toward, grid = to_device((torch.rand(70, 3), directions(), blobs()), device)
    with forced_path(path):
        passing, distance = look_around(points, toward, 0.05, 1 / 24, grid)
    with plain_torch():
        expected, where = look_around(points, toward, 0.05, 1 / 24, grid)
    torch.testing.assert_close(passing, expected, rtol=1e-3, atol=1e-4)
    # Half of the light may be stopped within rounding of a step.
    same = (distance == where) | ((distance - where).abs() < 1e-4)
    assert same.float().mean() > 0.99
    assert torch.isfinite(where).any() and torch.isinf(where).any()


def test_what_passes_is_what_passes_single_rays():
    torch.manual_seed(0)
    points, toward, grid = torch.rand(30, 3), directions(), blobs()
    passing, _ = look_around(points, toward, 0.05, 1 / 24, grid)
    origins, rays = points.repeat_interleave(40, 0), toward.repeat(30, 1)
    single = grid_transmittance(origins, rays, torch.full((1200,), 0.05), 1 / 24, grid)
    torch.testing.assert_close(passing.flatten(), single, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("count", [0, 1, 5, 6, 7, 300])
def test_any_number_of_rays_walks_to_the_end(count):
    torch.manual_seed(0)
    origins, toward, grid = torch.rand(count, 3), directions(count), blobs()
    arguments = origins, toward, 0.1 * torch.rand(count), 1 / 24, grid
    passing = grid_transmittance(*arguments)
    with plain_torch():
        expected = grid_transmittance(*arguments)
    assert passing.shape == (count,)
    torch.testing.assert_close(passing, expected, rtol=1e-3, atol=1e-4)


def test_a_slab_stops_half_of_the_light_where_it_begins():
    depths = torch.zeros(33, 33, 33)
    depths[:, :, 24:] = 1.0
    up = torch.tensor([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    passing, distance = look_around(
        torch.tensor([[0.5, 0.5, 0.25 + 1e-4]]), up, 0.0, 1 / 32, blocking_grid(depths)
    )
    # Eight cells of depth 1, and a ray ends once 7 are behind it.
    assert math.exp(-8.5) < float(passing[0, 0]) < math.exp(-6.5) and float(passing[0, 1]) == 1
    assert abs(float(distance[0, 0]) - 0.5) < 1 / 32 and math.isinf(float(distance[0, 1]))


def test_without_points_there_is_nothing_to_see():
    for block in (plain_torch(), forced_path("numba")):
        with block:
            passing, distance = look_around(torch.zeros(0, 3), directions(), 0.0, 0.1, blobs())
        assert passing.shape == distance.shape == (0, 40)
