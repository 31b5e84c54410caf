"""The outlines of masks, and what of them is no thinner than some pixels."""

import numpy as np
import pytest

from solver.fit.mask_outlines import along_outlines, near_outlines

FARTHEST = 4


def disc(size=40, radius=12.0):
    row, column = np.mgrid[0:size, 0:size] - (size - 1) / 2
    return row**2 + column**2 < radius**2


def test_steps_from_an_outline_are_those_of_a_king():
    mask = disc()
    found, steps = along_outlines(mask, FARTHEST)
    where = np.stack(np.nonzero(np.ones_like(mask)), 1)
    inside, outside = where[mask.ravel()], where[~mask.ravel()]
    expected = {}
    for index, place in enumerate(where):
        others = outside if mask.ravel()[index] else inside
        nearest = np.abs(others - place).max(1).min()
        if nearest <= FARTHEST:
            expected[index] = nearest
    assert dict(zip(found.tolist(), steps.tolist(), strict=True)) == expected


@pytest.mark.parametrize("slot", [False, True])
def test_outlines_of_what_is_thin_always_count(slot):
    mask = np.zeros((60, 60), bool)
    mask[20:50, 10:50] = True
    thick, _ = along_outlines(mask, FARTHEST)
    if slot:
        mask[20:40, 28:32] = False
    else:
        mask[2:20, 28:32] = True
    found, _ = along_outlines(mask, FARTHEST)
    rows, columns = np.unravel_index(found, mask.shape)
    beside = (np.abs(columns - 29.5) < 3) & (rows < 40) & (rows > 22 if slot else rows < 17)
    assert not beside.any()
    far = (np.abs(np.unravel_index(thick, mask.shape)[1] - 29.5) > 10).sum()
    assert (np.abs(columns - 29.5) > 10).sum() == far


def test_where_a_photo_ends_is_no_outline_nor_thin():
    mask = np.zeros((40, 40), bool)
    mask[:, :20] = True
    mask[:, 37:] = True  # the edge of something wide, as far as can be told
    rows, columns = np.unravel_index(along_outlines(mask, FARTHEST)[0], mask.shape)
    assert set(columns.tolist()) == {*range(16, 24), *range(33, 40)}
    assert set(rows.tolist()) == set(range(40))


@pytest.mark.parametrize("mask", [np.zeros((9, 9), bool), np.ones((9, 9), bool)])
def test_a_mask_without_an_outline_has_no_pixels_along_one(mask):
    assert all(len(values) == 0 for values in along_outlines(mask, FARTHEST))


def test_pixels_near_outlines_are_those_along_them():
    mask = np.roll(disc(), (5, -7), (0, 1))
    found, steps = along_outlines(mask, 2)
    assert near_outlines(mask, 2).sum() == len(found) and near_outlines(mask, 2).ravel()[found].all()
    assert set(steps.tolist()) == {1, 2}
