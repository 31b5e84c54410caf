"""Bilinear lookups on the sphere: the fast path against its twin, and both against the sphere itself."""

import numpy as np
import pytest
import torch

from solver.kernels.backend import forced_path
from solver.kernels.sphere import look_up

HEIGHT, WIDTH = 8, 16


def places():
    """Random ones, texel centres, and ones on seam and poles."""
    generator = torch.Generator().manual_seed(1)
    anywhere = torch.rand(6, 16, 2, generator=generator) * torch.tensor([WIDTH, HEIGHT])
    row, column = torch.meshgrid(torch.arange(HEIGHT), torch.arange(WIDTH), indexing="ij")
    centres = torch.stack([column, row], -1) + 0.5
    edges = torch.tensor([[0.0, 3.3], [WIDTH, 3.3], [5.2, 0.0], [5.2, HEIGHT], [0.0, 0.0], [0.3, 0.2]])
    edges = torch.cat([edges, torch.zeros(10, 2)])[None]
    return torch.cat([anywhere, centres, edges])


def values():
    return torch.rand(3, HEIGHT, WIDTH, generator=torch.Generator().manual_seed(2))


def test_the_fast_path_and_its_adjoint_are_those_of_the_twin():
    found = []
    for path in ("auto", "torch"):
        with forced_path(path):
            start = values().requires_grad_()
            out = look_up(start, places())
            cotangent = torch.rand(out.shape, generator=torch.Generator().manual_seed(3))
            (grad,) = torch.autograd.grad(out, start, cotangent)
            found.append((out, grad))
    torch.testing.assert_close(found[0][0], found[1][0], atol=1e-5, rtol=1e-5)
    torch.testing.assert_close(found[0][1], found[1][1], atol=1e-4, rtol=1e-4)


def test_the_adjoint_is_that_of_the_lookup():
    start = values().requires_grad_()
    out = look_up(start, places())
    cotangent = torch.rand(out.shape, generator=torch.Generator().manual_seed(4))
    (grad,) = torch.autograd.grad(out, start, cotangent)
    np.testing.assert_allclose((out * cotangent).sum().item(), (grad * start).sum().item(), rtol=1e-5)


def test_a_texels_centre_has_its_value():
    found = look_up(values(), places()[6 : 6 + HEIGHT])
    torch.testing.assert_close(found, values())


def test_what_lies_half_a_turn_away_goes_on_beyond_a_pole():
    at_pole = torch.tensor([[[5.2, 0.0], [5.2 + WIDTH / 2, 0.0], [5.2, HEIGHT], [5.2 - WIDTH / 2, HEIGHT]]])
    found = look_up(values(), at_pole)[:, 0]
    torch.testing.assert_close(found[:, 0], found[:, 1])
    torch.testing.assert_close(found[:, 2], found[:, 3])
    texel = values()
    left, right = (0.5 * (texel[:, 0, i] + texel[:, 0, i + WIDTH // 2]) for i in (4, 5))
    torch.testing.assert_close(found[:, 0], left + 0.7 * (right - left), atol=1e-5, rtol=1e-4)


def test_columns_go_on_around():
    seam = torch.tensor([[[0.0, 2.5], [float(WIDTH), 2.5]]])
    found = look_up(values(), seam)[:, 0]
    expected = 0.5 * (values()[:, 2, 0] + values()[:, 2, -1])
    for column in found.unbind(1):
        torch.testing.assert_close(column, expected)


def test_a_map_of_other_than_three_channels_is_refused():
    with pytest.raises(ValueError, match="three channels, this one has 1"):
        look_up(values()[:1], places())
