"""The contracted space around the box."""

import numpy as np
import pytest
import torch

from solver.field.room import Room, contract, expand


def room(size=12, nearest=0.0, allowed=None, **more):
    torch.manual_seed(3)
    allowed = torch.ones(8, 8, 8, dtype=torch.bool) if allowed is None else allowed
    return Room(torch.tensor([0.5, -1.0, 2.0]), 0.7, size, allowed, nearest, **more)


def test_contraction_keeps_the_box_and_holds_all_of_space():
    points = torch.from_numpy(np.random.default_rng(0).normal(0, 5, (4000, 3)))
    inside = points.abs().amax(-1) <= 1
    contracted = contract(points)
    torch.testing.assert_close(contracted[inside], points[inside])
    assert (contracted.abs() < 2).all()
    torch.testing.assert_close(
        torch.nn.functional.normalize(contracted, dim=-1),
        torch.nn.functional.normalize(points, dim=-1),
    )
    far = contract(torch.tensor([[1e6, 0.0, 0.0]]))
    assert far[0, 0] == pytest.approx(2, abs=1e-5)


def test_expanding_undoes_the_contraction():
    points = np.random.default_rng(1).normal(0, 4, (2000, 3))
    back = expand(contract(torch.from_numpy(points)).numpy())
    np.testing.assert_allclose(back, points, rtol=1e-9)


def test_contraction_bends_space_without_a_tear():
    directions = torch.nn.functional.normalize(torch.randn(200, 3).double(), dim=-1)
    edge = 1 / directions.abs().amax(-1, keepdim=True)
    inner, outer = contract(directions * edge * 0.999999), contract(directions * edge * 1.000001)
    torch.testing.assert_close(inner, outer, atol=1e-5, rtol=0)


def test_nothing_is_where_nothing_is_allowed():
    allowed = torch.zeros(8, 8, 8, dtype=torch.bool)
    allowed[4:] = True
    points = torch.rand(500, 3) * 4 - 2
    found = room(allowed=allowed).extinction(points)
    assert (found[points[:, 0] < 0] == 0).all()
    assert (found[points[:, 0] > 0] > 0).all()


def test_a_finer_grid_is_the_same_room():
    coarse, points = room(9), torch.rand(300, 3) * 3.6 - 1.8
    before = coarse.extinction(points).detach(), coarse.radiance(points).detach()
    coarse.upsample(17)  # every node of the old grid is one of the new
    assert coarse.size == 17
    torch.testing.assert_close(coarse.extinction(points), before[0], rtol=0.05, atol=1e-3)
    torch.testing.assert_close(coarse.radiance(points), before[1], rtol=0.02, atol=1e-3)
