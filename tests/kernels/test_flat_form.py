"""Flat forms with reserved lengths hold what exact ones do, and what fills them counts for nothing."""

import pytest
import torch

from solver.kernels.backend import forced_path
from solver.kernels.drawing import draw_depths, plan_rays
from solver.kernels.flat_form import (
    UnlikeObserved,
    filled_up,
    indices_of,
    nothing_follows,
    observed,
    offsets_of,
    reserved,
    room_for,
)
from solver.kernels.march import composite, march
from tests.kernels.paths import WITHOUT_CARD
from tests.kernels.test_drawing import POINTS

DEVICES = ["cpu", pytest.param("cuda", marks=WITHOUT_CARD)]
COUNTS = torch.tensor([2, 0, 3, 1])


def test_offsets_are_where_rows_begin_and_lengths_what_there_is():
    offsets, length = offsets_of(COUNTS)
    assert offsets.tolist() == [0, 2, 2, 5, 6] and length == 6
    assert room_for(COUNTS, length).shape == (6,) and filled_up(offsets, POINTS) == (POINTS,)


@pytest.mark.parametrize("device", DEVICES)
def test_reserved_lengths_leave_room_and_cut_the_last_rows_off(device):
    for length, expected in ((9, [0, 2, 2, 5, 6]), (5, [0, 2, 2, 4, 4])):
        with reserved([length]) as totals:
            offsets, found = offsets_of(COUNTS.to(device))
        assert offsets.tolist() == expected and found == length
        assert [int(total) for total in totals] == [6]


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("length", [4, 8])
def test_indices_are_those_that_are_chosen_and_then_the_last(length, device):
    chosen = torch.tensor([True, False, True, True, False, True, True], device=device)
    exact, none = indices_of(chosen)
    assert exact.tolist() == [0, 2, 3, 5, 6] and none is None
    with reserved([length]) as totals:
        indices, real = indices_of(chosen)
    fit = min(length - 1, 5)
    assert indices.tolist() == exact[:fit].tolist() + [6] * (length - fit)
    assert real.tolist() == [True] * fit + [False] * (length - fit) and int(totals[0]) == 5


def test_what_fills_up_is_as_the_first_item():
    values = torch.arange(12.0).view(6, 2)
    with reserved([6]):
        offsets, length = offsets_of(torch.tensor([1, 2]))
        (filled,) = filled_up(offsets, values)
        assert (room_for(values, length, fill=7) == 7).all()
    assert torch.equal(filled[:3], values[:3]) and (filled[3:] == values[0]).all()


def test_lengths_are_noted_in_order_and_for_as_many_flat_forms():
    with observed() as lengths:
        offsets_of(COUNTS)
        indices_of(COUNTS > 0)
        assert not nothing_follows(COUNTS[:0])
    assert lengths == [6, 3] and nothing_follows(COUNTS[:0]) and not nothing_follows(COUNTS)
    with pytest.raises(UnlikeObserved), reserved(lengths):
        offsets_of(COUNTS)
    with pytest.raises(UnlikeObserved), reserved(lengths[:1]):
        offsets_of(COUNTS)
        indices_of(COUNTS > 0)


def drawn(device):
    """Samples of rays, what of them is chosen, and the rays that leave from these."""
    generator = torch.Generator().manual_seed(2)

    def rand(*shape):
        return torch.rand(*shape, generator=generator).to(device)

    origins = torch.cat([rand(40, 2), -0.2 * rand(40, 1)], 1)
    directions = torch.nn.functional.normalize(rand(40, 3) + origins.new_tensor([0, 0, 2]), dim=-1)
    free = torch.zeros(8, 8, 8, dtype=torch.uint8, device=device)
    planes, lines = 3 * rand(3, 8, 8, 4), rand(3, 8, 4)
    segments = march(
        origins, directions, rand(40), rand(40), 0.05, 0.125, free, planes, lines, -4.0, 9.0, 1e-3
    )
    depth = (0.3 + segments.raw.abs() * 0.01).requires_grad_()
    weights, transmittance = composite(depth, segments.offsets)
    index, ray, times = draw_depths(weights, segments.offsets, 1 - transmittance, rand(40, 2), 1e-3)
    mass = (times / 2 * (1 - transmittance)[ray]).detach()
    plan = plan_rays(index * 7, mass, 6, POINTS.to(device), (3, 4))
    (weights.square().sum() + transmittance.sum()).backward()
    return segments, weights.detach(), depth.grad, index, ray, times, plan


@pytest.mark.parametrize("device", DEVICES)
def test_rays_are_walked_and_drawn_the_same_into_longer_arrays(device):
    with forced_path("warp"):
        with observed() as lengths:
            exact = drawn(device)
        with reserved([length + 50 for length in lengths]):
            longer = drawn(device)
    samples, chosen, rays = lengths
    for name in ("distance", "raw", "points", "ray"):
        one, other = getattr(longer[0], name), getattr(exact[0], name)
        assert torch.equal(one[:samples], other) and (one[samples:] == other[0]).all()
    assert torch.equal(longer[0].offsets, exact[0].offsets)
    for one, other in zip(longer[1:3], exact[1:3], strict=True):
        torch.testing.assert_close(one[:samples], other)
        assert (one[samples:] == 0).all()
    for one, other in zip(longer[3:6], exact[3:6], strict=True):
        assert torch.equal(one[:chosen], other)
    assert (longer[3][chosen:] == samples + 49).all() and (longer[5][chosen:] == 0).all()
    plan, same = longer[6], exact[6]
    assert torch.equal(plan.counts[:chosen], same.counts) and (plan.counts[chosen:] == 0).all()
    assert torch.equal(plan.share[:chosen], same.share) and (plan.share[chosen:] == 0).all()
    for name in ("sample", "keys", "u"):
        assert torch.equal(getattr(plan, name)[:rays], getattr(same, name))
    assert (plan.sample[rays:] == chosen + 49).all()


@pytest.mark.parametrize("device", DEVICES)
def test_what_has_no_room_is_left_out(device):
    with forced_path("warp"):
        with observed() as lengths:
            exact = drawn(device)
        with reserved([length - 20 for length in lengths]) as totals:
            shorter = drawn(device)
    samples = lengths[0] - 21
    assert int(totals[0]) == lengths[0] and int(shorter[0].offsets[-1]) == samples
    assert torch.equal(shorter[0].ray[:samples], exact[0].ray[:samples])
    assert shorter[1][-1] == 0 and torch.isfinite(shorter[2]).all()
    assert (shorter[3] < lengths[0] - 20).all() and (shorter[6].sample < lengths[1] - 20).all()
