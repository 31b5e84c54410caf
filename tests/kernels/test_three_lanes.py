"""Three doubles at once in numba: the arithmetic of numpy, and nothing but three numbers read or written."""

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba.core.errors import TypingError

from solver.kernels.three_lanes import read, write_columns, write_row

compiled = numba.njit()


@compiled
def arithmetic(table, number, rows):
    a, b = read(table, 0, 1), read(table, 1, 0)
    write_row(rows, 0, a + number * b)
    write_row(rows, 1, a * b - number)
    write_row(rows, 2, 2 - a)


@given(st.lists(st.floats(-100, 100), min_size=6, max_size=6), st.floats(-10, 10))
def test_arithmetic_is_that_of_numpy(values, number):
    table, rows = np.zeros((2, 2, 3)), np.zeros((3, 3), np.float32)
    a, b = table[0, 1], table[1, 0]
    a[:], b[:] = values[:3], values[3:]
    arithmetic(table, number, rows)
    np.testing.assert_allclose(rows, [a + number * b, a * b - number, 2 - a], rtol=1e-5, atol=1e-2)


@compiled
def move(table, i, j, rows, n):
    write_row(rows, n, read(table, i, j))


def test_three_numbers_are_moved_from_and_to_any_place_and_nowhere_else():
    table = np.arange(2 * 3 * 3, dtype=float).reshape(2, 3, 3)
    for i in range(2):
        for j in range(3):
            rows, expected = np.full((2, 4, 3), -1, np.float32)
            move(table, i, j, rows, i + j)
            expected[i + j] = table[i, j]
            np.testing.assert_array_equal(rows, expected)


@compiled
def turn(table, rows, n):
    write_columns(rows, n, read(table, 0, 0), read(table, 0, 1), read(table, 1, 0), read(table, 1, 1))


def test_four_are_written_as_columns_of_one_place_and_nowhere_else():
    table = np.arange(12, dtype=float).reshape(2, 2, 3)
    for n in range(3):
        rows, expected = np.full((2, 3, 3, 4), -1, np.float32)
        turn(table, rows, n)
        expected[n] = table.reshape(4, 3).T
        np.testing.assert_array_equal(rows, expected)


@pytest.mark.parametrize(
    "table, rows",
    [
        (np.zeros((2, 2, 3), np.float32), np.zeros((2, 3), np.float32)),
        (np.zeros((2, 3, 2)).swapaxes(1, 2), np.zeros((2, 3), np.float32)),
        (np.zeros((2, 2, 3)), np.zeros((2, 3))),
        (np.zeros((2, 2, 3)), np.zeros((2, 2, 3), np.float32)),
    ],
    ids=["read from floats", "read from another order", "written to doubles", "of more axes"],
)
def test_arrays_of_other_numbers_are_refused(table, rows):
    with pytest.raises(TypingError, match="a contiguous array of float"):
        move(table, 0, 0, rows, 0)
