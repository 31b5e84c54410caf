"""Marching and compositing against closed forms and their twins."""

import math

import numpy as np
import pytest
import torch

from solver.kernels.backend import forced_path, plain_torch
from solver.kernels.march import composite, grid_transmittance, march
from solver.kernels.skipping import between_corners, blocking_grid, free_distance, roots_of
from tests.kernels.paths import PATHS, to_device


def rays(count=200):
    torch.manual_seed(0)
    origins = torch.randn(count, 3) + 0.5
    directions = torch.nn.functional.normalize(torch.rand(count, 3) - origins, dim=-1)
    return origins, directions


def homogeneous(raw):
    """Factors of a field whose raw density is `raw` everywhere."""
    planes, lines = torch.zeros(3, 4, 4, 1), torch.ones(3, 4, 1)
    planes[0] = raw
    return planes, lines


@pytest.mark.parametrize("cells, filled, step", [(6, 0.4, 0.02), (40, 0.002, 0.011), (40, 0.05, 0.05)])
@pytest.mark.parametrize("path, device", PATHS)
def test_march_agrees_with_its_twin(cells, filled, step, path, device):
    origins, directions = rays()
    torch.manual_seed(4)
    arguments = (
        origins, directions, torch.zeros(200), torch.rand(200), step, 1 / cells,
        free_distance(torch.rand(cells, cells, cells) < filled),
        torch.randn(3, 8, 8, 4), torch.randn(3, 8, 4), -1.0, 8.0,
    )  # fmt: skip
    arguments = to_device(arguments, device)
    with forced_path(path):
        fused = march(*arguments)
    with plain_torch():
        plain = march(*arguments)
    # A sample within rounding of a cell's face may fall on either side.
    counts = torch.diff(fused.offsets) - torch.diff(plain.offsets)
    assert (counts != 0).float().mean() < 0.03
    same = counts == 0
    a, b = same[fused.ray], same[plain.ray]
    torch.testing.assert_close(fused.distance[a], plain.distance[b], rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(fused.raw[a], plain.raw[b], rtol=1e-3, atol=1e-3)
    torch.testing.assert_close(fused.points[a], plain.points[b], rtol=1e-4, atol=1e-4)


def test_samples_lie_in_occupied_cells_of_the_box():
    origins, directions = rays()
    occupied = torch.rand(5, 5, 5) > 0.5
    planes, lines = homogeneous(-5.0)
    result = march(
        origins,
        directions,
        torch.zeros(200),
        torch.rand(200),
        0.01,
        0.2,
        free_distance(occupied),
        planes,
        lines,
        -4.0,
        1.0,
    )
    assert len(result.ray) > 100
    points = origins[result.ray] + result.distance[:, None] * directions[result.ray]
    assert ((points >= -1e-5) & (points <= 1 + 1e-5)).all()
    cell = (points * 5).long().clamp(0, 4)
    near_face = ((points * 5) - (points * 5).round()).abs().amin(-1) < 1e-4
    assert (occupied[cell[:, 0], cell[:, 1], cell[:, 2]] | near_face).all()


def test_march_stops_once_the_ray_is_opaque():
    planes, lines = homogeneous(20.0)
    origin, direction = torch.tensor([[-1.0, 0.5, 0.5]]), torch.tensor([[1.0, 0.0, 0.0]])
    everywhere = torch.zeros(2, 2, 2, dtype=torch.uint8)
    result = march(
        origin, direction, torch.zeros(1), torch.full((1,), 0.5), 0.01, 0.5, everywhere, planes, lines, 0.0, 10.0,
        min_transmittance=1e-3,
    )  # fmt: skip
    # σ = 200, so a step lets e^-2 pass and the fourth is the first to leave less than 1e-3.
    assert len(result.ray) == 4


def test_weights_of_a_homogeneous_medium_have_their_closed_form():
    sigma, step, count = 3.0, 0.1, 40
    depth = torch.full((count,), sigma * step)
    weights, passing = composite(depth, torch.tensor([0, count]))
    t = np.arange(count) * step
    expected = np.exp(-sigma * t) - np.exp(-sigma * (t + step))
    np.testing.assert_allclose(weights.numpy(), expected, rtol=1e-4, atol=1e-7)
    assert math.isclose(float(passing), math.exp(-sigma * step * count), rel_tol=1e-4)
    assert math.isclose(float(weights.sum() + passing), 1.0, rel_tol=1e-5)


@pytest.mark.parametrize("path, device", PATHS)
def test_composite_agrees_with_its_twin_in_values_and_gradients(path, device):
    torch.manual_seed(5)
    offsets = torch.tensor([0, 0, 3, 10, 10, 30])  # empty rays at the start and in between
    depth = torch.rand(30, requires_grad=True)
    cotangents = torch.randn(30), torch.randn(5)
    depth, offsets, *cotangents = to_device([depth, offsets, *cotangents], device)
    results = []
    for taken in (path, "torch"):
        with forced_path(taken):
            values = composite(depth, offsets)
            results.append([*values, torch.autograd.grad(values, depth, cotangents)[0]])
    for a, b in zip(*results, strict=True):
        torch.testing.assert_close(a, b, rtol=1e-4, atol=1e-5)


def test_composite_twin_gradients_agree_with_finite_differences():
    from solver.kernels import march_torch

    depth = torch.rand(12, dtype=torch.float64, requires_grad=True)
    offsets = torch.tensor([0, 5, 5, 12])
    assert torch.autograd.gradcheck(lambda d: march_torch.composite(d, offsets), depth)


@pytest.mark.parametrize("path, device", PATHS)
def test_grid_transmittance_agrees_with_its_twin_and_with_an_empty_grid(path, device):
    origins, directions = rays()
    torch.manual_seed(6)
    depths = 0.5 * torch.rand(31, 31, 31) * (torch.rand(31, 31, 31) < 0.05)
    arguments = origins, directions, torch.zeros(200), 1 / 30
    grid, *arguments = to_device([blocking_grid(depths), *arguments], device)
    empty = blocking_grid(torch.zeros(3, 3, 3, device=device))
    with forced_path(path):
        fused = grid_transmittance(*arguments, grid)
        through_nothing = grid_transmittance(*arguments, empty)
    with plain_torch():
        plain = grid_transmittance(*arguments, grid)
    assert (fused < 0.9).float().mean() > 0.2
    torch.testing.assert_close(fused, plain, rtol=1e-3, atol=1e-3)
    assert (through_nothing == 1).all()


def test_free_distance_never_reaches_a_blocked_cell():
    torch.manual_seed(7)
    blocked = torch.rand(40, 40, 40) < 2e-4
    free = free_distance(blocked).long()
    assert ((free == 0) == blocked).all()
    where = blocked.nonzero()
    cell = torch.randint(40, (500, 3))
    nearest = (cell[:, None] - where[None]).abs().amax(-1).amin(-1)
    steps = free[cell[:, 0], cell[:, 1], cell[:, 2]]
    assert (steps <= nearest).all()
    assert (2 * steps >= nearest.clamp(max=32)).all()


def test_blocking_grid_keeps_roots_of_optical_depths_to_a_64th():
    roots = torch.rand(9, 9, 9) * 3.9
    roots[roots < 0.125] = 0
    assert ((roots_of(blocking_grid(roots.square())) - roots).abs() <= 1 / 64 + 1e-6).all()


def test_a_cell_is_empty_if_nothing_is_at_any_of_its_corners():
    torch.manual_seed(8)
    depths = torch.rand(9, 9, 9) * (torch.rand(9, 9, 9) < 0.1)
    lower = blocking_grid(depths)[:-1, :-1, :-1]
    there = roots_of(blocking_grid(depths)) > 0
    for i, j, k in torch.cartesian_prod(*[torch.arange(8)] * 3).tolist():
        full = there[i : i + 2, j : j + 2, k : k + 2].any()
        assert bool(lower[i, j, k] > 128) != bool(full)


def test_between_corners_values_are_trilinear_and_stay_what_they_are_beyond_the_box():
    x, y, z = torch.meshgrid(*[torch.arange(5.0)] * 3, indexing="ij")
    corners = 1 + x - 2 * y + 0.5 * z + 0.25 * x * y * z
    points = 1.4 * torch.rand(200, 3, generator=torch.Generator().manual_seed(9)) - 0.2
    x, y, z = (4 * points).clamp(0, 4).unbind(-1)
    torch.testing.assert_close(
        between_corners(corners, points), 1 + x - 2 * y + 0.5 * z + 0.25 * x * y * z, rtol=1e-5, atol=1e-4
    )
