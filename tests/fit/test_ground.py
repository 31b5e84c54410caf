"""What cutting out before a support is made of: the plane, its colours, places, counts of colours, cuts."""

import numpy as np
import pytest

from solver.fit.colour_counts import ColourCounts
from solver.fit.ground import MOST_CELLS, Ground, GroundColours
from solver.fit.outline import cut
from solver.fit.places import Places, PlacesIn, shown_by_all_but, times_seen
from solver.fit.seen_space import cell_centres
from solver.fit.standing import AT_LAST, WITHIN, Picture
from solver.fit.support import FEWEST, Support, support_of
from tests.fit.table_scene import REGION, table_scene

UP = np.array([0.0, 0.0, 1.0])
TABLE = Support(UP, 0.0)


@pytest.fixture(scope="module")
def cameras():
    return list(table_scene(views=6)[0].cameras)


def points_on(normal, height, count, rng, noise=0.003):
    """Points [count, 3] in the region near the plane."""
    points = rng.uniform(*REGION, (count, 3))
    off = points @ normal - height - rng.normal(0, noise, count)
    return points - off[:, None] * normal


def test_a_support_is_the_plane_most_points_are_on_as_level_as_it_is():
    rng = np.random.default_rng(1)
    tilted = np.array([0.1, -0.05, 1.0]) / np.linalg.norm([0.1, -0.05, 1.0])
    points = [points_on(tilted, 0.1, 300, rng), rng.uniform(*REGION, (200, 3))]
    found = support_of(np.concatenate(points), REGION, UP)
    assert found.normal @ tilted > np.cos(np.radians(0.5))
    assert found.height == pytest.approx(0.1, abs=0.004)
    first, second = found.axes()
    frame = np.stack([first, second, found.normal])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
    assert found.above(np.array([[0, 0, 1.0]])) == pytest.approx(tilted[2] - 0.1, abs=0.005)


@pytest.mark.parametrize(
    "normal, height, count",
    [((1.0, 0, 0), 0.1, 300), ((0, 0, 1.0), 1.1, 300), ((0, 0, 1.0), 0.0, FEWEST - 1)],
    ids=["a wall", "a ceiling", "hardly any points"],
)
def test_there_is_no_support_in(normal, height, count):
    points = points_on(np.array(normal), height, count, np.random.default_rng(2))
    assert support_of(points, REGION, UP) is None


def test_points_all_over_are_no_support():
    assert support_of(np.random.default_rng(3).uniform(*REGION, (500, 3)), REGION, UP) is None


def test_a_pixel_looks_at_the_ground_cell_whose_centre_is_seen_there(cameras):
    ground = Ground.around(TABLE, REGION, 0.02)
    np.testing.assert_allclose(ground.points[:, 2], 0, atol=1e-12)
    for camera in cameras:
        cells = ground.cells_in(camera)
        (row, column), inside, _ = camera.pixels_of(ground.points, cells.shape)
        seen = cells[row, column]
        away = ground.points[seen] - ground.points[inside]
        # A pixel is about as large as a cell, and longer where the ground is seen flat.
        assert (seen >= 0).mean() > 0.97
        assert np.median(np.linalg.norm(away[seen >= 0], axis=1)) < 0.03
        # What is above the horizon is no ground.
        assert (cells[0] == -1).all()
    assert Ground.around(TABLE, REGION, 1e-5).cells == MOST_CELLS


def test_a_gloss_is_like_the_ground_and_what_stands_on_it_is_not(cameras):
    rng = np.random.default_rng(4)
    ground = Ground.around(TABLE, REGION, 0.02)
    true = np.array([60, 10, 20]) + rng.normal(0, 6, (ground.cells**2, 3))
    photos, cells = [], []
    for index, camera in enumerate(cameras):
        cell = ground.cells_in(camera)
        row = np.mgrid[: cell.shape[0], : cell.shape[1]][0]
        gloss = 8 * np.sin(row / 40 + index)[..., None] * np.array([1.0, 0, 0])
        photo = np.where(cell[..., None] >= 0, true[cell] + gloss, 30.0)
        photos.append(photo + rng.normal(0, 0.5, photo.shape))
        cells.append(cell)
    photos[0][45:60, 40:55] = [40, -5, 30]
    pixels = [ground.pixels_in(camera) for camera in cameras]
    hidden = [np.zeros(cell.shape, bool) for cell in cells]
    hidden[0][45:60, 40:55] = True
    for known in (None, hidden):
        colours = GroundColours.seen_in(ground, pixels, photos, known)
        unlike = [colours.unlike(p, c) for p, c in zip(photos, cells, strict=True)]
        assert np.nanmedian(unlike[0][45:60, 40:55]) > 4
        assert np.nanmedian(unlike[1]) < 1.2
        assert np.isnan(unlike[0][0]).all()
    told = np.isfinite(colours.spread)
    # Of what fewer than three photos see, nothing is known.
    seen = sum(c.pixels_of(ground.points, cells[0].shape)[1].astype(int) for c in cameras)
    assert not told[seen < 3].any() and told[seen == len(cameras)].mean() > 0.9


def test_places_cover_a_picture_without_gaps_and_are_where_their_centres_are(cameras):
    centres = cell_centres(np.array([[-0.2] * 3, [0.2] * 3]) + [0, 0, 0.3], 24)
    inside = np.linalg.norm(centres - [0, 0, 0.3], axis=1) < 0.2
    places = Places(centres, 0.4 / 24).only(inside)
    for camera in cameras:
        placed = PlacesIn(places, camera, (camera.height, camera.width))
        row, column = np.mgrid[: camera.height, : camera.width].reshape(2, -1) + 0.5
        origins, directions = camera.rays(column, row)
        nearest = np.linalg.norm(np.cross([0, 0, 0.3] - origins, directions), axis=1)
        nearest = nearest.reshape(camera.height, camera.width)
        covered = placed.covered()
        assert covered[nearest < 0.18].all() and not covered[nearest > 0.25].any()
        high = placed.highest(places.centres[:, 2], -1.0)
        assert high[nearest < 0.1].min() > 0.2 and high[nearest > 0.3].max() < -0.9
        picture = np.arange(camera.height * camera.width).reshape(camera.height, camera.width)
        (row, column), seen, _ = camera.pixels_of(places.centres, picture.shape)
        np.testing.assert_array_equal(placed.values(picture)[seen], picture[row, column])


def test_places_that_all_but_a_few_masks_show_are_kept(cameras):
    places = Places(np.array([[0, 0, 0.3], [0.1, 0, 0.3], [50.0, 0, 0]]), 0.05)
    found = [PlacesIn(places, c, (c.height, c.width)) for c in cameras]
    seen = times_seen(found)
    np.testing.assert_array_equal(seen, [6, 6, 0])
    masks = [np.ones((c.height, c.width), bool) for c in cameras]
    masks[0][:] = False
    assert shown_by_all_but(0.2, found, masks, seen)[:2].all()
    assert not shown_by_all_but(0.1, found, masks, seen)[:2].any()


def test_colours_are_counted_and_those_close_by_are_likely_too():
    rng = np.random.default_rng(5)
    reds, greens = (rng.normal(c, 3, (400, 3)) for c in ((50, 60, 40), (60, -50, 40)))
    counts = ColourCounts.of([reds, reds[:10]])
    assert counts.share.sum() == pytest.approx(1)
    assert counts.likelihood(reds).mean() > 100 * counts.likelihood(greens).max()
    assert np.isfinite(np.log(counts.likelihood(np.array([[1e3, -1e3, 0]])))).all()


def test_an_outline_lies_on_an_edge_near_what_is_likely():
    colour = np.zeros((40, 40, 3))
    colour[10:30, 12:28] = [60, 30, 0]
    true = colour[..., 0] > 0
    odds = np.full(true.shape, -0.3)
    # A part is known for sure, and a pixel of it is known wrongly.
    odds[16:24, 16:24], odds[20, 20], odds[2, 2] = 2.0, -3.0, 3.0
    odds[true & (odds < 0)] = 0.1
    np.testing.assert_array_equal(cut(colour, odds, WITHIN), true)
    assert not cut(colour, np.full(true.shape, -1.0), WITHIN).any()
    assert cut(colour, np.full(true.shape, 1.0), WITHIN).all()


def test_an_outline_that_costs_little_follows_what_is_likely_more_closely():
    rng = np.random.default_rng(6)
    colour = np.full((40, 40, 3), 50.0) + rng.normal(0, 3, (40, 40, 3))
    thin = np.zeros((40, 40), bool)
    thin[10:30, 10:30] = thin[19:21, 30:36] = True
    found = [cut(colour, np.where(thin, 0.8, -0.8), within) for within in (WITHIN, AT_LAST)]
    assert not found[0][19:21, 32:36].any() and (found[1] == thin).all()


def test_a_picture_knows_its_shape(cameras):
    assert Picture(cameras[0], np.zeros((76, 100, 3))).shape == (76, 100)


def seen_by_few(few, views=20, cells=32):
    """A brown ground of which an object hides one cell: `few` photos see it there, and the others something
    that looks different in each. Its cells, photos' pixels and colours."""
    rng = np.random.default_rng(7)
    ground = Ground(TABLE, np.zeros(3), np.eye(3)[0], np.eye(3)[1], 0.1, cells)
    brown, pixels = np.array([35.0, 15, 30]), np.arange(cells**2, dtype=np.int32)
    photos = []
    for view in range(views):
        photo = brown + rng.normal(0, 0.5, (cells, cells, 3))
        if view >= few:
            photo[5, 7] = rng.uniform([0, -60, -60], [100, 60, 60])
        photos.append(photo)
    hidden_cell = np.ravel_multi_index((5, 7), (cells, cells))
    return ground, [pixels] * views, photos, hidden_cell, brown


def test_what_few_photos_see_below_an_overhang_is_the_ground_as_the_others_disagree():
    ground, pixels, photos, cell, brown = seen_by_few(5)
    found = GroundColours.seen_in(ground, pixels, photos, None)
    np.testing.assert_allclose(found.colour[cell], brown, atol=1.5)
    assert found.spread[cell] < 2 and found.by_few[cell] and found.by_few.sum() == 1
    # Once it is known where the object is, all count that do not show it.
    nothing = [np.zeros((32, 32), bool)] * len(photos)
    later = GroundColours.seen_in(ground, pixels, photos, nothing)
    assert np.linalg.norm(later.colour[cell] - brown) > 5 and later.by_few is None


def test_what_hardly_any_photos_agree_about_stays_unknown():
    ground, pixels, photos, cell, _ = seen_by_few(0)
    found = GroundColours.seen_in(ground, pixels, photos, None)
    assert np.isnan(found.unlike(photos[0], np.arange(32**2).reshape(32, 32))[5, 7])


def test_of_what_is_below_the_object_only_what_few_saw_is_known():
    ground, pixels, photos, cell, _ = seen_by_few(5)
    points = np.array([[0.35, 0.55, 0.4], [0.35, 0.95, 0.2], [-3.0, 0, 0.3]])
    below = ground.cells_below(points, 0.1)
    assert set(zip(*np.divmod(np.flatnonzero(below), 32), strict=True)) == {(3, 5), (3, 9)}
    assert ground.cells_below(points, 0.2).sum() == 5
    below[cell] = True
    found = GroundColours.seen_in(ground, pixels, photos, None).unknown_in(below)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(found.spread)), np.flatnonzero(below)[
        np.flatnonzero(below) != cell])  # fmt: skip
