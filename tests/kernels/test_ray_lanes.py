"""Numbers of several rays at once in numba: the arithmetic of numpy, ray by ray."""

import math

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba.core.errors import TypingError

from solver.kernels.lanes import LANES, load, store
from solver.kernels.ray_lanes import (
    CROWD,
    any_of,
    codes_at,
    crowd_of,
    floor,
    rays_of,
    where,
)

compiled = numba.njit(error_model="numpy")
RESULTS = 17


@compiled
def computed(x, y, number):
    """What both rays and numbers can do."""
    return (
        x + y * number, number - x, x * 2.0 - 1, x / (abs(y) + 1.0), 1.0 / (abs(x) + 0.5), -x, abs(y),
        math.sqrt(abs(x)), floor(x), min(x, y), max(x, 0.5), where(x < y, x, -1.0),
        where(x >= 0.0, number, y), where(x > y, 1.0, 2.0), where(0.25 * x <= y, y, x),
        min(number, max(y, x)), where((x < y) & (y < number), 1.0, 0.0),
    )  # fmt: skip


@compiled
def of_eight(a, b, number, results):
    like = rays_of(0.0)
    for k, value in enumerate(computed(load(a, (0,), like), load(b, (0,), like), number)):
        store(results, (k, 0), value)


@compiled
def of_a_crowd(a, b, number, results):
    like = crowd_of(0.0)
    for k, value in enumerate(computed(load(a, (0,), like), load(b, (0,), like), number)):
        store(results, (k, 0), value)


def expected(a, b, number):
    return np.stack([
        a + b * number, number - a, a * 2 - 1, a / (abs(b) + 1), 1 / (abs(a) + 0.5), -a, abs(b),
        np.sqrt(abs(a)), np.floor(a), np.minimum(a, b), np.maximum(a, 0.5), np.where(a < b, a, -1),
        np.where(a >= 0, number, b), np.where(a > b, 1, 2), np.where(0.25 * a <= b, b, a),
        np.minimum(number, np.maximum(b, a)), np.where((a < b) & (b < number), 1, 0),
    ])  # fmt: skip


finite = st.floats(-100, 100, width=32, allow_subnormal=False)


@pytest.mark.parametrize("count, run", [(LANES, of_eight), (CROWD, of_a_crowd)])
@given(data=st.data())
def test_arithmetic_comparisons_and_choices_are_those_of_numpy(count, run, data):
    values = st.lists(finite, min_size=count, max_size=count)
    a, b = np.array(data.draw(values), np.float32), np.array(data.draw(values), np.float32)
    number, results = data.draw(finite), np.zeros((RESULTS, count), np.float32)
    run(a, b, number, results)
    np.testing.assert_allclose(results, expected(a, b, np.float32(number)), rtol=1e-5, atol=2e-3)


@compiled
def of_numbers(test, a, b):
    return where(test, a, b), floor(a)


def test_numbers_are_chosen_and_rounded_down_as_rays_are():
    assert of_numbers(True, -1.5, 2.0) == (-1.5, -2.0)
    assert of_numbers(False, 2, 3) == (3.0, 2.0)


@compiled
def any_above(a, limit):
    return any_of(load(a, (0,), crowd_of(0.0)) > limit)


@pytest.mark.parametrize("lane", [0, 7, 8, CROWD - 1])
def test_what_is_true_of_one_ray_is_true_of_any(lane):
    values = np.zeros(CROWD, np.float32)
    assert not any_above(values, 0.5)
    values[lane] = 1.0
    assert any_above(values, 0.5)


@compiled
def looked_up(codes, at, results):
    like = crowd_of(0.0)
    x, y, z = load(at, (0, 0), like), load(at, (1, 0), like), load(at, (2, 0), like)
    store(results, (0,), codes_at(codes, x, y, z))


def test_codes_are_those_of_the_cells_in_which_rays_are():
    generator = np.random.default_rng(0)
    codes = generator.integers(0, 256, (5, 5, 5)).astype(np.uint8)
    at = generator.uniform(0, 5, (3, CROWD)).astype(np.float32)
    at[:, 0], at[:, 1] = 0.0, 4.999
    results = np.zeros(CROWD, np.float32)
    looked_up(codes, at, results)
    np.testing.assert_array_equal(results, codes[tuple(at.astype(int))])


@pytest.mark.parametrize("codes", [np.zeros((5, 5, 5)), np.zeros((5, 5), np.uint8)])
def test_codes_that_are_no_grid_of_bytes_are_refused(codes):
    with pytest.raises(TypingError, match="of bytes is wanted"):
        looked_up(codes, np.zeros((3, CROWD), np.float32), np.zeros(CROWD, np.float32))
