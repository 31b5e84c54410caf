"""Diffuse light between probes in one kernel: against its plain twin, values and gradients."""

import pytest
import torch

from solver.kernels.backend import forced_path, gradients_in_place
from solver.render.probes import Nodes, Probes
from tests.kernels.paths import PATHS, to_device


def probes(nodes=5, rows=12):
    torch.manual_seed(3)
    row = torch.randint(0, 1 + rows, (nodes,) * 3)
    grid = Probes()
    grid.nodes = [Nodes(row, 1e-4 + torch.rand(nodes, nodes, nodes), 1 / (nodes - 1))]
    return grid, torch.randn(1 + rows, 9, 3)


def inputs(count):
    torch.manual_seed(4)
    # Some outside of the box, some at its border.
    points = (1.4 * torch.rand(count, 3) - 0.2).masked_fill(torch.rand(count, 3) < 0.1, 1.0)
    return points, torch.nn.functional.normalize(torch.randn(count, 3), dim=-1)


def run(path, count, cotangent=None, device="cpu"):
    grid, table = probes()
    grid.nodes = [Nodes(*to_device(grid.nodes[0], device))]
    points, normals, table = to_device([*inputs(count), table], device)
    table.requires_grad_(), normals.requires_grad_()
    with forced_path(path):
        found = grid.irradiance(table, 0, points, normals)
        cotangent = torch.ones(count, 3) if cotangent is None else cotangent
        found.backward(cotangent.to(device))
    return found.detach().cpu(), table.grad.cpu(), normals.grad.cpu()


@pytest.mark.parametrize("count", [0, 1, 300])
@pytest.mark.parametrize("path, device", PATHS)
def test_kernel_and_twin_agree_in_values_and_gradients(count, path, device):
    cotangent = torch.randn(count, 3)
    for ours, theirs in zip(
        run(path, count, cotangent, device), run("torch", count, cotangent), strict=True
    ):
        torch.testing.assert_close(ours, theirs, atol=2e-5, rtol=2e-5)


def test_some_irradiance_is_cut_at_nothing_and_has_no_gradient_there():
    found, _, to_normals = run("numba", 300)
    dark = (found == 0).all(-1)
    assert 0 < dark.sum() < 300 and (found >= 0).all()
    assert (to_normals[dark] == 0).all() and (to_normals[~dark] != 0).any()


def test_gradients_of_a_table_that_is_a_leaf_are_added_where_it_lies():
    grid, table = probes()
    points, normals = inputs(50)
    table.requires_grad_()
    with gradients_in_place():
        for _ in range(2):
            grid.irradiance(table, 0, points, normals).sum().backward()
    once = run("torch", 50)[1]
    torch.testing.assert_close(table.grad, 2 * once, atol=1e-4, rtol=1e-4)


def test_one_probe_everywhere_is_that_probes_light():
    grid, table = probes()
    grid.nodes[0].row.fill_(7)
    points, normals = inputs(40)
    alone = Probes()
    alone.nodes = [Nodes(torch.full((2, 2, 2), 7), torch.ones(2, 2, 2), 1.0)]
    torch.testing.assert_close(
        grid.irradiance(table, 0, points, normals), alone.irradiance(table, 0, points, normals)
    )
