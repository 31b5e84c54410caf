"""Rectangle means against brute force: inside, across the seam, over the poles."""

import math

import numpy as np
import pytest
import torch

from solver.kernels import integral_numba
from solver.kernels.backend import forced_path, plain_torch
from solver.kernels.integral import corner_sums, prefix_sums, rectangle_mean
from solver.light.environment import EnvironmentMap
from tests.kernels.paths import PATHS, to_device

HEIGHT, WIDTH = 16, 32


def random_map():
    torch.manual_seed(0)
    return EnvironmentMap.from_radiance(torch.rand(HEIGHT, WIDTH, 3) + 0.1)


def brute_force(environment, centre, size, samples=400):
    """Mean over a fine grid of points of the rectangle, weighted by sin θ."""
    radiance = environment.radiance().detach().numpy()
    x = centre[0] + size[0] * ((np.arange(samples) + 0.5) / samples - 0.5)
    y = centre[1] + size[1] * ((np.arange(samples) + 0.5) / samples - 0.5)
    x, y = np.meshgrid(x, y)
    over = (y < 0) | (y > HEIGHT)
    y = np.where(y < 0, -y, np.where(y > HEIGHT, 2 * HEIGHT - y, y))
    x = np.where(over, x + WIDTH / 2, x) % WIDTH
    row = np.clip(y.astype(int), 0, HEIGHT - 1)
    # Each texel's solid angle is spread evenly over its rows, as in the table.
    edge = np.cos(np.arange(HEIGHT + 1) * math.pi / HEIGHT)
    weight = (edge[:-1] - edge[1:])[row]
    values = radiance[:, row, np.clip(x.astype(int), 0, WIDTH - 1)]
    return (values * weight).sum((1, 2)) / weight.sum()


@pytest.mark.parametrize(
    "centre, size",
    [
        ((10.3, 7.7), (3.2, 2.9)),
        ((0.4, 8.0), (5.0, 3.0)),
        ((31.9, 5.1), (9.0, 1.0)),
        ((12.0, 0.5), (6.0, 4.0)),
        ((3.0, 15.7), (8.0, 5.0)),
        ((20.0, 0.0), (32.0, 8.0)),
        ((7.5, 3.5), (1.0, 1.0)),
    ],
)
def test_rectangle_mean_agrees_with_brute_force(centre, size):
    environment = random_map()
    mean = rectangle_mean(
        environment.tables().table, environment.row_prefix, torch.tensor([centre]), torch.tensor([size])
    )
    expected = brute_force(environment, centre, size)
    np.testing.assert_allclose(mean[0].detach().numpy(), expected, rtol=5e-3)


@pytest.mark.parametrize("path, device", PATHS)
def test_kernel_agrees_with_its_twin_in_values_and_gradients(path, device):
    environment = random_map()
    table = environment.tables().table.detach().requires_grad_()
    torch.manual_seed(1)
    centre = (torch.rand(300, 2) * torch.tensor([WIDTH, HEIGHT])).requires_grad_()
    size = (1 + torch.rand(300, 2) * torch.tensor([20.0, 7.0])).requires_grad_()
    cotangent = torch.randn(300, 3)
    arguments = table, environment.row_prefix, centre, size, cotangent
    table, rows, centre, size, cotangent = to_device(arguments, device)
    with forced_path(path):
        fused = rectangle_mean(table, rows, centre, size)
        gradients = torch.autograd.grad(fused, (table, centre, size), cotangent)
    with plain_torch():
        plain = rectangle_mean(table, rows, centre, size)
    torch.testing.assert_close(fused, plain, rtol=1e-5, atol=1e-5)
    expected = torch.autograd.grad(plain, (table, centre, size), cotangent)
    for a, b in zip(gradients, expected, strict=True):
        torch.testing.assert_close(a, b, rtol=1e-4, atol=1e-4)


def test_a_scatter_in_bands_of_rows_is_the_scatter_of_one_task_to_the_bit():
    """Which takes bands depends on how many cores there are."""
    generator = np.random.default_rng(3)
    rows = random_map().row_prefix.numpy()
    # Some over the poles, some around the seam, some over more than one band.
    centre = (generator.random((500, 2)) * (WIDTH, HEIGHT)).astype(np.float32)
    size = (1 + 9 * generator.random((500, 2))).astype(np.float32)
    cotangent = generator.standard_normal((500, 3)).astype(np.float32)
    whole, banded = np.zeros((2, HEIGHT + 1, WIDTH + 1, 3))
    integral_numba._scatter(rows, centre, size, cotangent, 1, whole)
    integral_numba._scatter(rows, centre, size, cotangent, integral_numba.BANDS, banded)
    np.testing.assert_array_equal(banded, whole)
    assert np.abs(whole).max() > 0


def test_prefix_sums_agree_with_their_twin_in_values_and_gradients():
    torch.manual_seed(3)
    values = torch.rand(3, 5, 10, requires_grad=True)
    weights = torch.rand(5, dtype=torch.float64)
    cotangent = torch.randn(6, 11, 3, dtype=torch.float64)
    fused = prefix_sums(values, weights)
    with plain_torch():
        plain = prefix_sums(values, weights)
    torch.testing.assert_close(fused, plain)
    a, b = (torch.autograd.grad(out, values, cotangent)[0] for out in (fused, plain))
    torch.testing.assert_close(a, b)


def test_twin_gradients_by_position_and_size_agree_with_finite_differences():
    environment = random_map()
    tables = environment.tables()
    centre = torch.tensor([[10.3, 7.7], [0.3, 4.4], [5.2, 0.9]], dtype=torch.float64, requires_grad=True)
    size = torch.tensor([[3.1, 2.2], [4.3, 1.7], [6.1, 3.3]], dtype=torch.float64, requires_grad=True)
    from solver.kernels import integral_torch

    table = tables.table.detach()
    assert torch.autograd.gradcheck(
        lambda c, s: integral_torch.rectangle_mean(table, environment.row_prefix, c, s),
        (centre, size),
    )


def test_a_sun_leaves_no_negative_radiance_elsewhere():
    radiance = torch.full((64, 128, 3), 1e-3)
    radiance[10:12, 20:22] = 20_000.0
    environment = EnvironmentMap.from_radiance(radiance)
    torch.manual_seed(2)
    centre = torch.rand(5000, 2) * torch.tensor([128.0, 64.0])
    mean = rectangle_mean(environment.tables().table, environment.row_prefix, centre, torch.ones(5000, 2))
    assert (mean > 0.9e-3).all()


@pytest.mark.parametrize("columns", [3, 9])
def test_corner_sums_agree_with_their_twin_in_values_and_gradients(columns):
    torch.manual_seed(1)
    rows = torch.rand(50, columns, dtype=torch.float64, requires_grad=True)
    at, share = torch.randint(50, (20, 6)), torch.rand(20, 6, dtype=torch.float64) - 0.5
    cotangent = torch.rand(20, columns, dtype=torch.float64)
    results = []
    for path in ("numba", "torch"):
        with forced_path(path):
            sums = corner_sums(rows, at, share)
            results.append((sums, *torch.autograd.grad(sums, rows, cotangent)))
    assert type(sums.grad_fn) is not type(corner_sums(rows, at, share).grad_fn)
    for a, b in zip(*results, strict=True):
        torch.testing.assert_close(a, b)
