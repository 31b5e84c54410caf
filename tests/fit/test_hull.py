"""The start from a visual hull: factors of a volume, and the hull they stand for."""

import pytest
import torch

from solver.field.field import MicrofacetField
from solver.fit.visual_hull import decompose, start_from_hull
from solver.kernels.vm import vm_sum


def grid(size, low=-1.0, high=1.0):
    ticks = torch.linspace(low, high, size)
    return torch.stack(torch.meshgrid(ticks, ticks, ticks, indexing="ij"), -1)


def test_a_volume_that_is_a_sum_of_products_is_decomposed_without_a_rest():
    torch.manual_seed(0)
    planes, lines = torch.randn(3, 9, 9, 2), torch.randn(3, 9, 2)
    nodes = torch.stack(torch.meshgrid(*[torch.arange(9.0)] * 3, indexing="ij"), -1).reshape(-1, 3)
    target = vm_sum(nodes, planes, lines).view(9, 9, 9)
    found = decompose(target, 9)
    torch.testing.assert_close(vm_sum(nodes, *found).view(9, 9, 9), target, atol=1e-3, rtol=1e-3)


@pytest.mark.parametrize("size", [40, 65])
def test_the_start_has_the_hulls_shape(size):
    torch.manual_seed(0)
    field = MicrofacetField(torch.zeros(3), 1.0, size)
    centres = grid(48, -1 + 1 / 48, 1 - 1 / 48)
    # A box and a ball that touch: no sum of few products.
    distance = torch.minimum(
        (centres - torch.tensor([0.3, 0.2, 0.0])).norm(dim=-1) - 0.4,
        (centres + torch.tensor([0.3, 0.3, 0.2])).abs().amax(-1) - 0.35,
    )
    start_from_hull(field, distance, 100.0, -12.0, 12.0)
    raw = field.raw_density(centres.reshape(-1, 3) * 0.5 + 0.5).view(48, 48, 48)
    clear = distance.abs() > 0.03
    assert ((raw > 0) == (distance < 0))[clear].float().mean() > 0.999
