"""Lids that the visual hull puts on hollows: taken off, and nothing else."""

import numpy as np
import pytest

from solver.fit import hollows
from solver.fit.held_cells import held_by_silhouettes
from solver.fit.hollows import Carving, carve_hollows
from solver.fit.seen_space import cell_centres
from solver.fit.visual_hull import carve
from tests.fit.hollow_scenes import (
    BOX,
    CELLS,
    ball,
    block,
    cup,
    flat_gloss,
    mirrored,
    painted,
    photographed,
    shares,
    stump,
)


def test_a_cup_loses_its_lid_and_keeps_its_walls():
    cameras, photos, hull = photographed(cup, painted)
    too_much, true = shares(cup, hull, carve_hollows(cameras, photos, hull, BOX))
    assert too_much < 0.3 and true > 0.99


@pytest.mark.parametrize("shape, colour", [(cup, painted), (block, mirrored), (stump, flat_gloss)])
def test_where_the_first_floor_is_no_better_than_the_lid_the_best_one_tells(shape, colour, monkeypatch):
    monkeypatch.setattr(hollows, "BETTER", 0.0)
    monkeypatch.setattr(hollows, "air_seen", lambda *given: np.zeros((CELLS,) * 3))
    cameras, photos, hull = photographed(shape, colour)
    too_much, true = shares(shape, hull, carve_hollows(cameras, photos, hull, BOX))
    assert true > 0.99 and (too_much < 0.3) == (shape is cup)


def test_silhouettes_hold_a_cups_wall_but_not_its_lid():
    cameras, photos, hull = photographed(cup, painted)
    held = held_by_silhouettes(cameras, photos, hull, BOX)
    points = cell_centres(BOX, CELLS).reshape(*hull.shape, 3)
    radius = np.hypot(points[..., 0], points[..., 1])
    lid = hull & (np.abs(points[..., 2] - 0.48) < 0.03) & (radius < 0.4)
    wall = hull & (np.abs(points[..., 2]) < 0.3) & (np.abs(radius - 0.69) < 0.02)
    assert lid.sum() > 200 and held[lid].mean() < 0.02
    assert wall.sum() > 200 and held[wall].mean() > 0.9


@pytest.mark.parametrize("colour", [painted, mirrored])
@pytest.mark.parametrize("shape", [ball, block])
def test_what_has_no_hollow_stays_as_it_is(shape, colour):
    cameras, photos, hull = photographed(shape, colour)
    kept = carve_hollows(cameras, photos, hull, BOX)
    assert shares(shape, hull, kept)[1] > 0.99


@pytest.mark.parametrize("shape, colour, sheen", [(stump, flat_gloss, True), (cup, painted, False)])
def test_a_flat_gloss_is_told_from_a_lid_though_photos_disagree_about_both(shape, colour, sheen):
    cameras, photos, hull = photographed(shape, colour)
    held = held_by_silhouettes(cameras, photos, hull, BOX)
    carving = Carving(cameras, photos, hull, BOX, held)
    lids = carving.lids
    loose = (lids.spread > carving.tolerance) & ~held.ravel()[carving.index[lids.cells]]
    assert loose.sum() > 200
    assert carving.is_sheen(lids.cells[loose], carving.seen_from(lids.cells)[0][:, loose]) == sheen


def test_a_finer_hull_is_carved_at_its_own_cells():
    cameras, photos, _ = photographed(cup, painted)
    masks = [photo.pixels[..., 3] > 0.5 for photo in photos]
    hull = carve(cameras, masks, BOX, 2 * CELLS)
    kept = carve_hollows(cameras, photos, hull, BOX)
    assert kept.shape == hull.shape and not (kept & ~hull).any()
    assert 0.3 < kept.sum() / hull.sum() < 0.8


def test_nothing_is_carved_from_a_few_photos_or_none_of_a_hull():
    cameras, photos, hull = photographed(cup, painted)
    few = carve_hollows(cameras[:4], photos[:4], hull, BOX)
    np.testing.assert_array_equal(few, hull)
    assert not carve_hollows(cameras, photos, np.zeros_like(hull), BOX).any()
