"""Angles by series: against numpy, on all of their range and where the series meet."""

import numba
import numpy as np

from solver.kernels.angles_numba import angle_of, cosine_sine_of_turns


@numba.njit
def _turned(turns, out):
    for i in range(len(turns)):
        out[i] = cosine_sine_of_turns(turns[i])


@numba.njit
def _angles(x, y, out):
    for i in range(len(x)):
        out[i] = angle_of(x[i], y[i])


def test_cosines_and_sines_are_numpys_to_single_precision():
    eighths = np.arange(-16, 17) / 8
    turns = np.concatenate([np.linspace(-2, 2, 4001), eighths - 1e-9, eighths, eighths + 1e-9])
    out = np.empty((len(turns), 2))
    _turned(turns, out)
    np.testing.assert_allclose(out[:, 0], np.cos(2 * np.pi * turns), atol=3e-8)
    np.testing.assert_allclose(out[:, 1], np.sin(2 * np.pi * turns), atol=3e-8)


def test_angles_are_numpys_to_single_precision():
    around = np.linspace(-np.pi + 1e-9, np.pi, 4001)
    x, y = np.cos(around), np.sin(around)
    x = np.concatenate([x, 1e-6 * x, [0.0, 0.0, 2.0, -2.0, 1.0, -1.0]])
    y = np.concatenate([y, 1e-6 * y, [3.0, -3.0, 0.0, 0.0, 1.0, -1.0]])
    out = np.empty(len(x))
    _angles(x, y, out)
    np.testing.assert_allclose(out, np.arctan2(y, x), atol=2e-8)
