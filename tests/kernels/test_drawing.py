"""Random choices of a step: equal twins, draws by weight, rays shared out by mass."""

import pytest
import scipy.stats
import torch

from solver.kernels.backend import forced_path, plain_torch
from solver.kernels.drawing import draw_depths, plan_rays
from tests.kernels.paths import PATHS, to_device

POINTS = torch.quasirandom.SobolEngine(2, scramble=True, seed=3).draw(64)


def rays(count=400):
    """Weights of rays with none to twelve samples each; some so faint that nothing is drawn."""
    generator = torch.Generator().manual_seed(1)
    counts = torch.randint(0, 13, (count,), generator=generator)
    offsets = torch.nn.functional.pad(counts.cumsum(0), (1, 0))
    ray = torch.repeat_interleave(torch.arange(count), counts)
    faint = torch.rand(count, generator=generator) < 0.2
    weights = torch.rand(len(ray), generator=generator) / 13
    weights = torch.where(faint[ray], 1e-5 * weights, weights)
    opacity = torch.zeros(count).index_add(0, ray, weights)
    return weights, offsets, opacity, ray


@pytest.mark.parametrize("depths", [1, 2, 5])
@pytest.mark.parametrize("path, device", PATHS)
def test_all_twins_draw_the_same_samples(depths, path, device):
    weights, offsets, opacity, ray = to_device(rays(), device)
    u = torch.rand(len(opacity), depths).to(device)
    with forced_path(path):
        fused = draw_depths(weights, offsets, opacity, u, 1e-3)
    with plain_torch():
        plain = draw_depths(weights, offsets, opacity, u, 1e-3)
    for a, b in zip(fused, plain, strict=True):
        assert torch.equal(a, b)
    index, found, times = fused
    assert torch.equal(found, ray[index]) and (index[1:] > index[:-1]).all()
    drawn = torch.zeros_like(offsets[1:]).index_add(0, found, times)
    assert torch.equal(drawn, torch.where(opacity > 1e-3, depths, 0))


def test_samples_are_drawn_as_often_as_they_weigh():
    weights = torch.tensor([0.1, 0.0, 0.3, 0.05, 0.25])
    many = 40_000
    u = torch.rand(many, 2, generator=torch.Generator().manual_seed(0))
    offsets = torch.arange(many + 1) * 5
    index, _, times = draw_depths(weights.repeat(many), offsets, torch.full((many,), 0.7), u, 0.0)
    counts = torch.zeros(5, dtype=torch.long).index_add(0, index % 5, times)
    assert counts[1] == 0
    kept = weights > 0
    expected = 2 * many * weights[kept].double() / weights[kept].double().sum()
    assert scipy.stats.chisquare(counts[kept].numpy(), expected.numpy()).pvalue > 1e-3


@pytest.mark.parametrize("along", [1, 3, 40])
@pytest.mark.parametrize("samples, count", [(500, 1), (500, 16), (500, 300), (0, 4)])
@pytest.mark.parametrize("path, device", PATHS)
def test_all_twins_plan_the_same_rays(samples, count, along, path, device):
    index = torch.arange(samples)
    keys = index // along * 4096 + index % along + 2**33
    mass = torch.rand(samples, generator=torch.Generator().manual_seed(2)) ** 4
    mass[::50] = 0
    arguments = to_device([keys, mass, count, POINTS, (12, 2**32 - 1)], device)
    with forced_path(path):
        fused = plan_rays(*arguments)
    with plain_torch():
        plain = plan_rays(*arguments)
    for a, b in zip(fused, plain, strict=True):
        assert a.dtype == b.dtype and torch.equal(a, b)


def test_rays_of_a_sample_are_spread_and_keep_their_keys_apart():
    keys = torch.tensor([5, 9]) * 4096
    plan = plan_rays(keys, torch.tensor([1.0, 0.5]), 64, POINTS, (1, 2))
    assert plan.counts.tolist()[0] == 64 and plan.counts[1] in (32, 33)
    assert torch.equal(plan.together, plan.counts)
    assert len(plan.keys.unique()) == len(plan.keys)
    first = plan.u[plan.sample == 0]
    # One point in each eighth of either axis: as even as the set they come from.
    for axis in range(2):
        assert torch.bincount((first[:, axis] * 8).long(), minlength=8).min() >= 6


@pytest.mark.parametrize("path, device", PATHS)
def test_rays_of_all_samples_along_a_ray_are_spread_together(path, device):
    """What lies in one surface's fringe shares its lobe; ray by ray on its own, none would be spread."""
    samples, rays = 64, 64
    keys = torch.arange(3)[:, None] * 4096 + torch.arange(samples)
    mass = torch.rand(3, samples, generator=torch.Generator().manual_seed(3))
    mass = mass / mass.sum(1, keepdim=True)
    arguments = to_device([keys.flatten(), mass.flatten(), rays, POINTS, (1, 2)], device)
    with forced_path(path):
        plan = plan_rays(*arguments)
    counts = plan.counts.view(3, samples).sum(1)
    assert (counts - rays).abs().max() <= 1, "of a sum that rounding may leave below one"
    assert torch.equal(plan.together.view(3, samples), counts[:, None].expand(-1, samples))
    for ray in range(3):
        u = plan.u[plan.sample // samples == ray].cpu()
        for axis in range(2):
            assert torch.bincount((u[:, axis] * 8).long(), minlength=8).min() >= 6
    assert len(plan.keys.unique()) == len(plan.keys)
