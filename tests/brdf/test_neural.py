"""The neural term: what it is told, what it must not push, where it begins."""

import math

import pytest
import torch

from solver.brdf.neural import NeuralTerm
from solver.light.spherical_harmonics import sh_basis


def inputs(count=20, features=5):
    torch.manual_seed(0)
    half, light = torch.nn.functional.normalize(torch.randn(2, count, 3), dim=-1)
    return torch.randn(count, features), half, light, torch.rand(count)


def test_directions_are_told_as_sharply_as_a_lobe_of_that_roughness_sees_them():
    """Ref-NeRF's integrated encoding: degree l is dimmed by exp(−l(l + 1)/2 · α)."""
    features, half, light, alpha = inputs()
    term = NeuralTerm(5, width=8)
    term.layers = torch.nn.Identity()
    told = torch.logit(term(features, half, light, alpha).double())

    def encoded(direction):
        columns, basis = [], sh_basis(direction, 4)
        for degree in range(5):
            dimmed = torch.exp(-degree * (degree + 1) / 2 * alpha)
            columns.append(basis[:, degree**2 : (degree + 1) ** 2] * dimmed[:, None])
        return torch.cat([*columns, direction], -1)

    expected = torch.cat([features, encoded(half), encoded(light)], -1).double()
    torch.testing.assert_close(told, expected, rtol=1e-4, atol=1e-5)


def test_features_learn_from_it_and_directions_and_roughness_do_not():
    given = [value.requires_grad_() for value in inputs()]
    NeuralTerm(5, width=8)(*given).sum().backward()
    features, *others = given
    assert features.grad.abs().sum() > 0
    assert all(value.grad is None for value in others)


@pytest.mark.parametrize("initial", [0.5, 0.9])
def test_it_begins_close_to_its_initial_value(initial):
    g = NeuralTerm(5, width=64, initial=initial)(*inputs(200)).detach()
    assert g.shape == (200, 3)
    assert math.isclose(float(g.median()), initial, abs_tol=0.1)
