"""VM lookups: fused kernels against their plain twin, and the twin against finite differences."""

import numba
import numpy as np
import pytest
import torch

from solver.kernels import vm, vm_torch
from solver.kernels.backend import forced_path, gradients_in_place, plain_torch
from solver.kernels.vm_adjoint_numba import MOST_BANDS, bands_of
from tests.kernels.paths import PATHS, to_device


def factors(size, channels, dtype=torch.float32):
    shapes = (3, size, size, channels), (3, size, channels)
    return [torch.randn(*shape, dtype=dtype, requires_grad=True) for shape in shapes]


@pytest.mark.parametrize("name", ["vm_sum", "vm_products", "vm_gradient"])
@pytest.mark.parametrize("size, channels", [(2, 1), (7, 16), (9, 24), (5, 13)])
@pytest.mark.parametrize("path, device", PATHS)
def test_kernel_agrees_with_its_twin_in_values_and_gradients(name, size, channels, path, device):
    torch.manual_seed(1)
    # Points outside the grid are clamped to it, by both.
    points = torch.rand(500, 3) * (size + 1) - 1
    points, *arguments = to_device([points, *factors(size, channels)], device)
    with forced_path(path):
        fused = getattr(vm, name)(points, *arguments)
    with plain_torch():
        plain = getattr(vm, name)(points, *arguments)
    cotangent = torch.randn_like(plain)
    torch.testing.assert_close(fused, plain, rtol=1e-4, atol=1e-4)
    with forced_path(path):
        gradients = torch.autograd.grad(fused, arguments, cotangent)
    for a, b in zip(gradients, torch.autograd.grad(plain, arguments, cotangent), strict=True):
        torch.testing.assert_close(a, b, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("name", ["vm_sum", "vm_products", "vm_gradient"])
def test_twin_gradients_agree_with_finite_differences(name):
    torch.manual_seed(2)
    points = torch.rand(6, 3, dtype=torch.float64) * 3
    arguments = factors(4, 2, torch.float64)
    assert torch.autograd.gradcheck(lambda p, q: getattr(vm_torch, name)(points, p, q), arguments)


def test_products_reproduce_nodes():
    planes, lines = torch.randn(3, 4, 4, 2), torch.randn(3, 4, 2)
    x, y, z = 1, 2, 3
    products = vm.vm_products(torch.tensor([[1.0, 2.0, 3.0]]), planes, lines)[0]
    expected = [planes[0, x, y] * lines[0, z], planes[1, x, z] * lines[1, y]]
    expected.append(planes[2, y, z] * lines[2, x])
    torch.testing.assert_close(products, torch.cat(expected))


@pytest.mark.parametrize("name", ["vm_sum", "vm_products", "vm_gradient"])
def test_adjoints_of_many_points_are_the_twins_and_the_same_bits_on_any_number_of_cores(name):
    """So many that bands of rows share them; most are close together, so that bands are narrow."""
    torch.manual_seed(5)
    points = torch.cat([torch.rand(4000, 3) * 39, 20 + torch.randn(6000, 3)])
    arguments = factors(40, 11)
    with plain_torch():
        plain = getattr(vm, name)(points, *arguments)
        cotangent = torch.randn_like(plain)
        expected = torch.autograd.grad(plain, arguments, cotangent)
    found, usual = [], numba.get_num_threads()
    try:
        for threads in (1, numba.config.NUMBA_NUM_THREADS):
            numba.set_num_threads(threads)
            fused = getattr(vm, name)(points, *arguments)
            found.append(torch.autograd.grad(fused, arguments, cotangent))
    finally:
        numba.set_num_threads(usual)
    for one, many, plain in zip(*found, expected, strict=True):
        assert torch.equal(one, many)
        torch.testing.assert_close(one, plain, rtol=1e-3, atol=1e-2)


@pytest.mark.parametrize("count, bands", [(0, 1), (511, 1), (512, 2), (100_000, MOST_BANDS)])
def test_bands_have_all_points_in_the_order_of_their_rows_and_never_reach_each_other(count, bands):
    size, rng = 30, np.random.default_rng(1)
    points = (rng.random((count, 3)) ** 3 * size).astype(np.float32)
    order, firsts = bands_of(points, size)
    assert firsts.shape == (2, bands + 1) and order.shape == (2, count)
    for axis in range(2):
        assert sorted(order[axis]) == list(range(count)) and firsts[axis, -1] == count
        rows = np.minimum(points[order[axis], axis].astype(int), size - 2)
        assert (np.diff(rows) >= 0).all()
        of_bands = [rows[a:b] for a, b in zip(firsts[axis], firsts[axis, 1:], strict=False) if a < b]
        # Differences add to the row before a point's own, and to the second behind it.
        for band, at_the_same_time in zip(of_bands, of_bands[2:], strict=False):
            assert band.max() + 2 < at_the_same_time.min() - 1
    assert (np.diff(firsts) >= 0).all()


def test_kernels_give_the_same_bits_twice():
    torch.manual_seed(3)
    points = torch.rand(3000, 3) * 9
    arguments = factors(10, 16)
    runs = [torch.autograd.grad(vm.vm_sum(points, *arguments).sum(), arguments) for _ in range(2)]
    assert all(torch.equal(a, b) for a, b in zip(*runs, strict=True))


@pytest.mark.parametrize("name, axes", [("smooth_planes", 2), ("smooth_lines", 1)])
@pytest.mark.parametrize("size, channels, reach", [(2, 1, 1), (9, 16, 2), (5, 3, 13)])
@pytest.mark.parametrize("path, device", PATHS)
def test_smoothing_agrees_with_its_twin_in_values_and_gradients(
    name, axes, size, channels, reach, path, device
):
    torch.manual_seed(4)
    factor = torch.randn(3, *[size] * axes, channels, requires_grad=True)
    half = torch.rand(reach)
    taps = torch.cat([half, torch.ones(1), half.flip(0)]) / (1 + 2 * half.sum())
    factor, cotangent = to_device([factor, torch.randn_like(factor)], device)
    results = []
    for taken in (path, "torch"):
        with forced_path(taken):
            out = getattr(vm, name)(factor, taps)
            results.append((out, *torch.autograd.grad(out, factor, cotangent)))
    for a, b in zip(*results, strict=True):
        torch.testing.assert_close(a, b)


@pytest.mark.parametrize("name, axes", [("smooth_planes", 2), ("smooth_lines", 1)])
def test_the_gradient_of_a_leaf_that_is_smoothed_is_added_where_it_lies(name, axes):
    torch.manual_seed(6)
    factor, taps = torch.randn(3, *[9] * axes, 11), torch.tensor([0.25, 0.5, 0.25])
    smooth, cotangent = getattr(vm, name), torch.randn_like(factor.requires_grad_())
    (expected,) = torch.autograd.grad(smooth(factor, taps), factor, cotangent)
    with gradients_in_place():
        smooth(factor, taps).backward(cotangent)
        lies_at = factor.grad.data_ptr()
        smooth(factor, taps).backward(cotangent)
    assert factor.grad.data_ptr() == lies_at
    torch.testing.assert_close(factor.grad, 2 * expected)
