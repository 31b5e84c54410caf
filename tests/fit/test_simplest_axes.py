"""The axes along which a shape is simplest, against shapes whose axes are known."""

import time
from threading import get_ident

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from solver.fit.simplest_axes import _Shape, different_turns, simplest_axes
from solver.threads import usable_cores

CELLS = 64
SAME = Rotation.create_group("O")


def centres():
    ticks = (np.arange(CELLS) + 0.5) / CELLS * 2 - 1
    return np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), axis=-1)


def boxes(points):
    """Two boxes of other lengths, one on the other."""
    x, y, z = np.moveaxis(points, -1, 0)
    low = (np.abs(x) < 0.5) & (np.abs(y) < 0.3) & (np.abs(z + 0.15) < 0.15)
    return low | ((np.abs(x - 0.1) < 0.2) & (np.abs(y) < 0.2) & (np.abs(z - 0.2) < 0.2))


def rows_of_balls(points):
    x, y, z = np.moveaxis(points, -1, 0)
    near = ((x + 0.6) % 0.4 - 0.2) ** 2 + ((y + 0.6) % 0.4 - 0.2) ** 2 + z**2 < 0.15**2
    return near & (np.abs(x) < 0.6) & (np.abs(y) < 0.4)


def ball(points):
    return np.linalg.norm(points, axis=-1) < 0.6


def cylinder(points):
    return (np.linalg.norm(points[..., :2], axis=-1) < 0.35) & (np.abs(points[..., 2]) < 0.6)


def off(axes, truth):
    """Degrees between axes, whichever of them is called which."""
    turn = Rotation.from_matrix(axes) * Rotation.from_matrix(truth).inv()
    return np.degrees((SAME * turn).magnitude().min())


@pytest.mark.parametrize("shape", [boxes, rows_of_balls])
@pytest.mark.parametrize("seed", range(4))
def test_the_axes_of_a_turned_shape_are_found(shape, seed):
    axes = Rotation.random(random_state=seed).as_matrix()
    found = simplest_axes(shape(centres() @ axes.T))
    assert off(found, axes) < 3
    # Of the same axes by other names, those closest to the world's.
    others = (SAME * Rotation.from_matrix(found)).magnitude()
    assert Rotation.from_matrix(found).magnitude() == pytest.approx(others.min())
    np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(found) == pytest.approx(1)


def test_of_a_cylinder_the_axis_is_found():
    axes = Rotation.from_rotvec([0.5, 0.3, 0.0]).as_matrix()
    found = simplest_axes(cylinder(centres() @ axes.T))
    assert np.degrees(np.arccos(np.abs(found @ axes[2]).max())) < 3


@pytest.mark.parametrize("shape", [boxes, rows_of_balls, ball, cylinder])
def test_what_is_straight_already_or_the_same_all_around_is_not_turned(shape):
    assert simplest_axes(shape(centres())) is None


def test_of_nothing_no_axes_are_simplest():
    assert simplest_axes(np.zeros((8, 8, 8), bool)) is None
    assert simplest_axes(np.ones((1, 1, 1), bool)) is None


def test_a_shape_at_the_border_of_its_grid_is_no_longer_than_that():
    """Outside of the grid is nothing, not more of the same."""
    bar = np.zeros((24, 24, 24), bool)
    bar[:, 8:16, 10:14] = True
    assert simplest_axes(bar) is None


class Asked(Exception):
    """To stop."""


def test_it_is_told_all_the_way_how_far_the_search_is():
    told = []
    occupied = boxes(centres() @ Rotation.random(random_state=0).as_matrix().T)
    found = simplest_axes(occupied, lambda done: told.append((done, get_ident())))
    np.testing.assert_array_equal(found, simplest_axes(occupied))
    shares, threads = zip(*told, strict=True)
    assert sorted(shares) == list(shares) and shares[0] < 0.02 and shares[-1] <= 1
    assert len(shares) > 200
    assert set(threads) == {get_ident()}, "whoever listens does so in one thread"


@pytest.mark.parametrize("share", [0.1, 0.55])
def test_a_search_that_is_to_stop_looks_at_hardly_any_more_turns(share, monkeypatch):
    looked, error_of = [], _Shape.log_error

    def slow(shape, axes):
        looked.append(time.sleep(0.005))
        return error_of(shape, axes)

    def stop(done):
        if done > share:
            looked.clear()
            raise Asked

    monkeypatch.setattr(_Shape, "log_error", slow)
    with pytest.raises(Asked):
        simplest_axes(boxes(centres() @ Rotation.random(random_state=0).as_matrix().T), stop)
    assert len(looked) <= 4 * usable_cores()


def test_turns_of_the_lattice_are_close_to_any_and_all_different():
    turns = different_turns(7)
    assert 250 < len(turns) < 7**3
    sought = Rotation.random(200, random_state=1)
    nearest = [min((same * one * turns.inv()).magnitude().min() for same in SAME) for one in sought]
    assert np.degrees(max(nearest)) < 17
    quaternions = different_turns(5).as_quat()
    vectors = np.abs(quaternions[:, :3] / quaternions[:, 3:])
    inner = Rotation.from_quat(quaternions[(vectors.max(1) < 0.4) & (vectors.sum(1) < 0.99)])
    for number, one in enumerate(inner):
        others = inner[np.arange(len(inner)) != number].inv()
        assert min(np.degrees((same * one * others).magnitude().min()) for same in SAME) > 5
