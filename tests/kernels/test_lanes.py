"""Eight numbers at once in numba: the arithmetic of numpy, at any place of an array."""

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba.core.errors import TypingError

from solver.kernels.lanes import LANES, add_to, eight_of, load, store, total

compiled = numba.njit()


@compiled
def arithmetic(a, b, number, results):
    many = eight_of(number)
    x, y = load(a, (0,), many), load(b, (0,), many)
    store(results, (0, 0), x + y * number)
    store(results, (1, 0), number * x - y)
    store(results, (2, 0), number - x)
    store(results, (3, 0), many * x + (y - number))
    return total(x * y)


@compiled
def move(source, target, at, i, j, like):
    store(target, (i, j), load(source, (at,), like))
    add_to(target, (i, j), load(source, (at,), like))


@compiled
def total_of(number):
    return total(number)


finite = st.floats(-100, 100, width=32)


@given(st.lists(finite, min_size=2 * LANES, max_size=2 * LANES), finite)
def test_arithmetic_is_that_of_numpy(values, number):
    a, b = np.array(values, np.float32).reshape(2, LANES)
    number, results = np.float32(number), np.zeros((4, LANES), np.float32)
    summed = arithmetic(a, b, number, results)
    expected = [a + b * number, number * a - b, number - a, number * a + (b - number)]
    np.testing.assert_allclose(results, expected, rtol=1e-5, atol=1e-2)
    np.testing.assert_allclose(summed, (a * b).sum(), rtol=1e-4, atol=1e-1)


@compiled
def move_eight(source, target, at, i, j):
    move(source, target, at, i, j, eight_of(np.float32(0)))


@given(st.integers(0, 12), st.integers(0, 2), st.integers(0, 5))
def test_numbers_are_moved_from_and_to_any_place_and_nowhere_else(at, i, j):
    source = np.arange(20, dtype=np.float32)
    for count, run in ((LANES, move_eight), (1, lambda *a: move(*a, np.float32(0)))):
        target, expected = np.zeros((2, 3, 13), np.float32)
        run(source, target, at, i, j)
        expected[i, j : j + count] = 2 * source[at : at + count]
        np.testing.assert_array_equal(target, expected)


def test_the_total_of_a_number_is_the_number():
    assert total_of(np.float32(2.5)) == 2.5


@pytest.mark.parametrize(
    "array",
    [np.zeros((2, 20)), np.zeros((20, 2), np.float32).T, np.zeros((2, 2, 20), np.float32)],
    ids=["double", "transposed", "of more axes"],
)
def test_arrays_whose_rows_are_not_of_floats_side_by_side_are_refused(array):
    with pytest.raises(TypingError, match="lanes are of contiguous float32 arrays"):
        move(np.zeros(20, np.float32), array, 0, 0, 0, np.float32(0))


@compiled
def with_a_double(number):
    return total(eight_of(np.float32(0)) + number)


@pytest.mark.parametrize("of_float", [with_a_double, total_of])
def test_doubles_are_refused_where_floats_are_wanted(of_float):
    of_float(np.float32(1))
    with pytest.raises(TypingError):
        of_float(1.0)
