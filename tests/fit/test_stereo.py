"""Air in hollows, told by what photos of neighbours show alike."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from solver.fit import stereo
from solver.fit.held_cells import held_by_silhouettes
from solver.fit.seen_space import cell_centres
from solver.fit.stereo import AIR, air_seen
from tests.cameras.box_scene import look_at
from tests.fit.hollow_scenes import (
    BOX,
    CELLS,
    block,
    cup,
    mirror_door,
    mirroring,
    painted,
    photographed,
)


@cache
def air_of(shape, colour, change=lambda photos: photos):
    """[K, K, K] bool: what is taken for air of a shape's hull; and what is."""
    cameras, photos, hull = photographed(shape, colour)
    held = held_by_silhouettes(cameras, photos, hull, BOX)
    found = air_seen(cameras, change(photos), hull, held, BOX) > AIR
    return found & hull & ~held, hull & ~shape(cell_centres(BOX, CELLS)).reshape(hull.shape)


def test_the_inside_of_a_painted_cup_is_air_and_its_bottom_is_not():
    found, air = air_of(cup, painted)
    assert (found & air).sum() > 0.65 * air.sum()
    assert (found & ~air).sum() < 0.01 * air.sum()


def test_photos_of_other_exposure_and_tint_tell_the_same():
    def changed(photos):
        rng = np.random.default_rng(0)
        gains = rng.uniform(0.5, 0.9, (len(photos), 1)) * rng.uniform(0.9, 1.1, (len(photos), 4))
        gains[:, 3] = 1
        return [
            replace(photo, pixels=(photo.pixels * gain).astype(np.float32))
            for photo, gain in zip(photos, gains, strict=True)
        ]

    usual, _ = air_of(cup, painted)
    found, _ = air_of(cup, painted, changed)
    assert (found & usual).sum() > 0.9 * (found | usual).sum()


@pytest.mark.parametrize("colour", [painted, mirroring, mirror_door])
def test_what_is_solid_has_no_air(colour):
    assert not air_of(block, colour)[0].any()


@pytest.mark.parametrize(
    "colour, told_by",
    [(mirror_door, {"OFTEN": 0.0, "ALL_AROUND": -1.0}), (mirroring, {"OPENED": 1.0})],
)
def test_the_image_in_a_mirror_is_told_from_a_hollow_by_what_sees_it_and_what_is_left(
    colour, told_by, monkeypatch
):
    for name, value in told_by.items():
        monkeypatch.setattr(stereo, name, value)
    found, air = air_of.__wrapped__(block, colour)
    assert (found & ~air).sum() > 500


def test_cells_are_compared_by_the_correlation_of_their_patches():
    cameras, photos, hull = photographed(cup, painted)
    with ThreadPoolExecutor() as pool:
        cells = stereo._Stereo(cameras[::4], photos[::4], hull, BOX, pool)
    pair, correlation = next(iter(cells.pairs.items()))
    one, other = (cells.grid(cells.views[number].brightness) for number in pair)
    found = cells.grid(correlation)
    inner = np.argwhere(np.ones((CELLS - 4,) * 3) > 0) + 2
    rng, told = np.random.default_rng(1), 0
    for x, y, z in rng.permutation(inner)[:4000]:
        around = np.s_[x - 2 : x + 3, y - 2 : y + 3, z - 2 : z + 3]
        if not hull[around].all():
            continue
        best = -1.0
        for cut in (np.s_[2, :, :], np.s_[:, 2, :], np.s_[:, :, 2]):
            a, b = one[around][cut].ravel(), other[around][cut].ravel()
            deviations = max(a.std(), stereo.FAINT) * max(b.std(), stereo.FAINT)
            best = max(best, np.cov(a, b, bias=True)[0, 1] / deviations)
        assert found[x, y, z] == pytest.approx(best, abs=1e-3)
        told += 1
    assert told > 20


def test_what_a_photo_shows_right_beside_a_hull_most_of_which_is_behind_it_lies_on_rays():
    """A fixed bug: rays were as wide as a depth below 0 says, so some were taken for one or for none."""
    cameras, photos, hull = photographed(cup, painted)
    beside = replace(cameras[0], camera_to_world=look_at(np.array([0.45, 0, 0]), np.array([3.0, 0, 0])))
    with ThreadPoolExecutor() as pool:
        cells = stereo._Stereo([beside], photos[:1], hull, BOX, pool)
    ray, seen = cells.views[0].ray, beside.in_frame(cells.points)
    np.testing.assert_array_equal(ray > 0, seen)
    pixels = beside.project(cells.points)[0]
    width = cells.edge * beside.fx / np.median(np.abs(beside.project(cells.points)[1]))
    assert seen.sum() > 50
    for number in np.unique(ray[seen]):
        assert np.ptp(pixels[ray == number], axis=0).max() <= width


def test_too_few_photos_tell_of_no_air():
    cameras, photos, hull = photographed(cup, painted)
    held = held_by_silhouettes(cameras[:3], photos[:3], hull, BOX)
    assert not air_seen(cameras[:3], photos[:3], hull, held, BOX).any()
