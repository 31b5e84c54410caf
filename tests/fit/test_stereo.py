"""Air in hollows, told by what photos of neighbours show alike."""

from dataclasses import replace

import numpy as np
import pytest

from solver.fit import stereo
from solver.fit.held_cells import held_by_silhouettes
from solver.fit.seen_space import cell_centres
from solver.fit.stereo import AIR, air_seen
from tests.fit.hollow_scenes import (
    BOX,
    CELLS,
    ball,
    block,
    cup,
    mirrored,
    mirroring,
    painted,
    photographed,
)


def air_of(shape, colour, change=lambda photos: photos):
    """[K, K, K] bool: what is taken for air of a shape's hull; and what is."""
    cameras, photos, hull = photographed(shape, colour)
    held = held_by_silhouettes(cameras, photos, hull, BOX)
    found = air_seen(cameras, change(photos), hull, held, BOX) > AIR
    return found & hull & ~held, hull & ~shape(cell_centres(BOX, CELLS)).reshape(hull.shape)


def test_the_inside_of_a_painted_cup_is_air_and_its_bottom_is_not():
    found, air = air_of(cup, painted)
    assert (found & air).sum() > 0.7 * air.sum()
    assert (found & ~air).sum() < 0.03 * air.sum()


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


@pytest.mark.parametrize("colour", [painted, mirrored, mirroring])
@pytest.mark.parametrize("shape", [ball, block])
def test_what_is_solid_has_no_air(shape, colour):
    assert not air_of(shape, colour)[0].any()


def test_the_image_in_a_mirror_would_be_taken_for_a_hollow_but_that_it_is_seen_from_one_side(
    monkeypatch,
):
    monkeypatch.setattr(stereo, "ALL_AROUND", -1.0)
    found, air = air_of(block, mirroring)
    assert (found & ~air).sum() > 500


def test_cells_are_compared_by_the_correlation_of_their_patches():
    cameras, photos, hull = photographed(cup, painted)
    cells = stereo._Stereo(cameras, photos, hull, BOX)
    grids = [cells.grid(view.brightness) for view in cells.views]
    number = 7
    near = np.argsort(cells.apart[number])
    near = [i for i in near if 4 < cells.apart[number, i] < 50][:6]
    found = cells.grid(cells._correlation(number))
    inner = np.argwhere(np.ones((CELLS - 4,) * 3) > 0) + 2
    rng, told = np.random.default_rng(1), 0
    for x, y, z in rng.permutation(inner)[:4000]:
        around = np.s_[x - 2 : x + 3, y - 2 : y + 3, z - 2 : z + 3]
        if not hull[around].all():
            continue
        across = [np.s_[2, :, :], np.s_[:, 2, :], np.s_[:, :, 2]]
        own = [grids[number][around][cut].ravel() for cut in across]
        best = []
        for axis, cut in enumerate(across):
            others = [grids[i][around][cut].ravel() for i in near]
            deviation = max(own[axis].std(), stereo.FAINT)
            each = sorted(
                np.cov(own[axis], other, bias=True)[0, 1] / deviation / max(other.std(), stereo.FAINT)
                for other in others
            )
            best.append(np.mean(each[-3:]))
        assert found[x, y, z] == pytest.approx(max(best), abs=1e-3)
        told += 1
    assert told > 20


def test_too_few_photos_tell_of_no_air():
    cameras, photos, hull = photographed(cup, painted)
    held = held_by_silhouettes(cameras[:3], photos[:3], hull, BOX)
    assert not air_seen(cameras[:3], photos[:3], hull, held, BOX).any()
