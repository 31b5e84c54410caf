"""Compile the fused kernels before the clock of a fit starts; numba keeps them on disk."""

from __future__ import annotations

import torch

from .adam import Moments, Rates, adam_step
from .hashing import uniform
from .integral import prefix_sums, rectangle_mean
from .march import composite, grid_transmittance, march
from .skipping import blocking_grid
from .specular import Blockers, specular
from .vm import smooth_planes, vm_gradient, vm_products, vm_sum


def compile_kernels() -> None:
    """Run every kernel once, forwards and backwards, on a handful of numbers."""
    points = torch.rand(4, 3)
    uniform(torch.arange(4), 0, 2)

    def leaf(*shape: int) -> torch.Tensor:
        return torch.rand(*shape, requires_grad=True)

    planes, lines = leaf(3, 4, 4, 8), leaf(3, 4, 8)
    vm_sum(points, planes, lines).sum().backward()
    vm_products(points, planes, lines).sum().backward()
    vm_gradient(points, smooth_planes(planes, 0.5, 0.25), lines).sum().backward()
    directions = torch.nn.functional.normalize(points - 0.4, dim=-1)
    segments = march(
        points, directions, torch.zeros(4), torch.zeros(4), 0.1, 0.25, torch.zeros(4, 4, 4).byte(),
        planes, lines, -4.0, 25.0,
    )  # fmt: skip
    depth = torch.rand(len(segments.ray), requires_grad=True)
    weights, transmittance = composite(depth, segments.offsets)
    (weights.sum() + transmittance.sum()).backward()
    blockers = Blockers(torch.zeros(3), 1.0, 0.25, blocking_grid(torch.rand(4, 4, 4)), 0.1)
    grid_transmittance(points, directions, torch.zeros(4), 0.25, blockers.blocking)
    rows = torch.linspace(0, 1, 5, dtype=torch.float64)
    table, centre = prefix_sums(leaf(3, 4, 8), rows[1:]), leaf(4, 2)
    rectangle_mean(table, rows, centre, torch.ones(4, 2)).sum().backward(retain_graph=True)
    normals = directions.clone().requires_grad_()
    radiance, _ = specular(
        normals, leaf(4), leaf(4, 3), table, directions, points, torch.ones(4, dtype=torch.long),
        torch.ones(4), torch.rand(4, 2), rows, True, True, blockers,
    )  # fmt: skip
    radiance.sum().backward()
    moments = Moments(torch.zeros(4, 3), torch.zeros(4, 3))
    adam_step(torch.zeros(4, 3), torch.ones(4, 3), moments, Rates(0.1, 0.9, 0.99, 1e-15, 1))
