"""Shading few of a ray's samples: right in the mean, in value and in gradient, and with little noise."""

import pytest
import torch

from solver.kernels.backend import forced_path
from solver.kernels.march import composite
from solver.render.depths import all_depths, random_depths

COUNT = 6
REPEATS = 20_000


def ray(opacity_of_step):
    """One ray's optical depths and what its samples show: smooth, with a step in the middle."""
    depth = torch.full((COUNT,), opacity_of_step) * torch.linspace(0.5, 1.5, COUNT)
    values = torch.linspace(1.0, 1.3, COUNT) + (torch.arange(COUNT) > 3) * 0.5
    return depth.requires_grad_(), values.requires_grad_()


def seen(depth, values, depths):
    """The same ray many times over, each with its own random number."""
    repeated = depth.repeat(REPEATS)
    offsets = torch.arange(REPEATS + 1) * COUNT
    weights, transmittance = composite(repeated, offsets)
    torch.manual_seed(0)
    found = random_depths(weights, offsets, 1 - transmittance, torch.rand(REPEATS, depths))
    return found.gather(values.repeat(REPEATS)[found.index, None])[:, 0], found


def exact(depth, values):
    weights, _ = composite(depth, torch.tensor([0, COUNT]))
    return (weights * values).sum()


def test_values_and_gradients_are_right_in_the_mean():
    for opacity_of_step in (0.1, 0.8):
        depth, values = ray(opacity_of_step)
        estimate, _ = seen(depth, values, 2)
        expected = exact(depth, values)
        torch.testing.assert_close(estimate.mean(), expected, rtol=5e-3, atol=0)
        got = torch.autograd.grad(estimate.mean(), (depth, values))
        want = torch.autograd.grad(expected, (depth, values))
        for a, b in zip(got, want, strict=True):
            torch.testing.assert_close(a, b, rtol=0.05, atol=5e-3)


def test_a_ray_that_is_half_transparent_is_no_noisier_for_it():
    """Every ray gets all its depths; only what they show differs, not how much of it there is."""
    depth, _ = ray(0.1)
    estimate, found = seen(depth, torch.ones(COUNT), 2)
    torch.testing.assert_close(estimate, estimate.mean().expand(REPEATS), rtol=1e-4, atol=1e-5)
    shares = torch.zeros(REPEATS).index_add(0, found.ray, found.share)
    torch.testing.assert_close(shares, torch.ones(REPEATS))


def test_one_depth_is_right_in_the_mean():
    depth, values = ray(0.5)
    estimate, found = seen(depth, values, 1)
    assert len(found.index) == REPEATS
    torch.testing.assert_close(estimate.mean(), exact(depth, values), rtol=5e-3, atol=0)


def test_all_heavy_samples_make_up_for_the_faint_ones():
    depth, _ = ray(0.5)
    offsets = torch.tensor([0, COUNT])
    weights, transmittance = composite(depth, offsets)
    index = torch.zeros(COUNT, dtype=torch.long)
    found = all_depths(weights, index, 1 - transmittance, 0.1)
    assert 0 < len(found.index) < COUNT
    gathered = found.gather(torch.ones(len(found.index), 1))
    torch.testing.assert_close(gathered[:, 0], 1 - transmittance)


@pytest.mark.parametrize("depths", [1, 3])
def test_the_kernel_agrees_with_its_twin_in_values_and_gradients(depths):
    torch.manual_seed(2)
    rays, each = 40, 7
    offsets = torch.arange(rays + 1) * each
    leaves = [torch.rand(rays * each) ** 3, torch.rand(rays * each, 5)]
    leaves[0][3 * each : 4 * each] = 0.0
    u, cotangent = torch.rand(rays, depths), torch.rand(rays, 5)
    results = []
    for path in ("numba", "torch"):
        depth, values = (leaf.clone().requires_grad_() for leaf in leaves)
        with forced_path(path):
            weights, transmittance = composite(depth, offsets)
            found = random_depths(weights, offsets, 1 - transmittance, u)
            seen = found.gather(values[found.index])
            results.append((seen, *torch.autograd.grad(seen, (depth, values), cotangent)))
    for a, b in zip(*results, strict=True):
        assert (a != 0).any()
        torch.testing.assert_close(a, b, rtol=1e-4, atol=1e-6)
