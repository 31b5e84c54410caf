"""The optimiser's step against torch's own, its twin, and what "lazy" promises."""

import pytest
import torch

from solver.kernels.adam import Moments, Rates, adam_step, mean_root_square
from solver.kernels.backend import forced_path, gradients_in_place, plain_torch
from solver.kernels.vm import vm_gradient, vm_products, vm_sum
from tests.kernels.paths import PATHS, to_device


def run(gradients, start):
    parameter = start.clone()
    moments = Moments(torch.zeros_like(start), torch.zeros_like(start))
    for count, gradient in enumerate(gradients, 1):
        adam_step(parameter, gradient.clone(), moments, Rates(0.01, 0.9, 0.99, 1e-15, count))
    return parameter, moments


def test_where_all_is_touched_it_is_torchs_adam():
    torch.manual_seed(0)
    start, gradients = torch.randn(5, 7, 4), torch.randn(6, 5, 7, 4)
    theirs = torch.nn.Parameter(start.clone())
    optimiser = torch.optim.Adam([theirs], lr=0.01, betas=(0.9, 0.99), eps=1e-15)
    for gradient in gradients:
        theirs.grad = gradient.clone()
        optimiser.step()
    torch.testing.assert_close(run(gradients, start)[0], theirs.detach(), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("columns", [8, 100])
@pytest.mark.parametrize("path, device", PATHS)
def test_kernel_agrees_with_its_twin(path, device, columns):
    torch.manual_seed(1)
    start = torch.randn(40, columns)
    gradients = torch.randn(5, 40, columns) * (torch.rand(5, 40, 1) < 0.5)
    start, gradients = to_device([start, gradients], device)
    with forced_path(path):
        fused, moments = run(gradients, start)
    with plain_torch():
        plain, others = run(gradients, start)
    torch.testing.assert_close(fused, plain)
    for a, b in zip(moments, others, strict=True):
        torch.testing.assert_close(a, b)


@pytest.mark.parametrize("path, device", [*PATHS, ("torch", "cpu")])
def test_untouched_rows_stay_and_gradients_are_cleared(path, device):
    torch.manual_seed(2)
    parameter, gradient = to_device([torch.randn(6, 3), torch.randn(6, 3)], device)
    gradient[2] = 0
    before = parameter.clone()
    moments = Moments(torch.ones_like(parameter), torch.ones_like(parameter))
    with forced_path(path):
        adam_step(parameter, gradient, moments, Rates(0.1, 0.9, 0.99, 1e-15, 1))
    changed = (parameter != before).any(-1)
    assert changed.tolist() == [True, True, False, True, True, True]
    assert (moments.mean[2] == 1).all() and (moments.square[2] == 1).all()
    assert (gradient == 0).all()


@pytest.mark.parametrize("lookup", [vm_sum, vm_products, vm_gradient])
def test_gradients_added_in_place_are_those_that_autograd_adds(lookup):
    torch.manual_seed(3)
    planes = torch.randn(3, 6, 6, 8, requires_grad=True)
    lines = torch.randn(3, 6, 8, requires_grad=True)
    points = torch.rand(2, 30, 3) * 5

    def total():
        return sum(lookup(p, planes, lines).square().sum() for p in points)

    expected = torch.autograd.grad(total(), (planes, lines))
    with gradients_in_place():
        total().backward()
    torch.testing.assert_close(planes.grad, expected[0], rtol=1e-4, atol=1e-3)
    torch.testing.assert_close(lines.grad, expected[1], rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize("count", [1, 300])
def test_the_mean_of_running_squares_is_the_twins_and_that_after_the_step(count):
    torch.manual_seed(2)
    gradient = torch.randn(3, 40, 80)
    moments = Moments(torch.zeros(3, 40, 80), torch.rand(3, 40, 80) ** 4)
    found = mean_root_square(gradient, moments, 0.99, count)
    with plain_torch():
        twin = mean_root_square(gradient, moments, 0.99, count)
    adam_step(torch.zeros(3, 40, 80), gradient, moments, Rates(0.1, 0.9, 0.99, 1e-15, count))
    after = (moments.square / (1 - 0.99**count)).sqrt().mean()
    assert found == pytest.approx(float(twin), rel=1e-5)
    assert found == pytest.approx(float(after), rel=1e-5)
