"""Adjoints of the fused CPU kernels for VM lookups (`vm_numba`), whose gradients many points add to.

Points are put in the order of their rows in a plane, and bands of rows are tasks: first every other band,
then those between. What a point adds reaches only a row or two further, so no two tasks at once write to
one address. Lines belong to all bands: each has a copy, which are added up at the end. Bands depend on
points alone, so the sums have the same order on any number of cores.
"""

import numba
import numpy as np

from .compiling import inlined, kernel
from .lanes import LANES, eight_of, load
from .vm_point_numba import (
    AXIS_A,
    AXIS_B,
    AXIS_C,
    HALF,
    ZERO,
    cell,
    cells_of,
    corner_weights,
    difference_cell,
    spread,
    spread_differences,
)

MOST_BANDS = 8
POINTS_OF_A_BAND = 512
"""at least; fewer are not worth a task"""
LEAST_ROWS = 4
"""of a band: differences reach from the row before a point's cell to the second behind it"""


@kernel
def by_rows(points, chosen, size, order, firsts):
    """Indices [2, M] of chosen points [M] in the order of their rows, and where each band begins
    [2, bands + 1]: with equally many points, as far as whole rows and `LEAST_ROWS` allow. The first two
    planes' rows are along x, the third's along y."""
    count, bands = chosen.shape[0], firsts.shape[1] - 1
    for axis in numba.prange(2):
        rows, begins = np.empty(count, np.int32), np.zeros(size + 1, np.int64)
        for at in range(count):
            rows[at], _ = cell(points[chosen[at], axis], size)
            begins[rows[at] + 1] += 1
        band, first_row = 0, 0
        firsts[axis, 0] = 0
        for row in range(size):
            begins[row + 1] += begins[row]
            full = begins[row + 1] * bands >= count * (band + 1)
            if full and band < bands - 1 and row + 1 - first_row >= LEAST_ROWS:
                band, first_row = band + 1, row + 1
                firsts[axis, band] = begins[row + 1]
        firsts[axis, band + 1 :] = count
        for at in range(count):
            order[axis, begins[rows[at]]] = chosen[at]
            begins[rows[at]] += 1


def bands_of(points, size, chosen=None):
    """See `by_rows`; without `chosen` of all points."""
    chosen = np.arange(len(points), dtype=np.intp) if chosen is None else chosen
    bands = min(MOST_BANDS, 1 + len(chosen) // POINTS_OF_A_BAND)
    order, firsts = np.empty((2, len(chosen)), np.int32), np.empty((2, bands + 1), np.int64)
    by_rows(points, chosen, size, order, firsts)
    return order, firsts


@inlined
def tasks_of(bands, parity):
    """How many bands of all pairs there are with even or odd numbers."""
    return 3 * ((bands + 1 - parity) // 2)


@inlined
def pair_and_band(task, parity):
    return task % 3, 2 * (task // 3) + parity


@inlined
def add_up(parts, grad_lines):
    """Add the lines that bands have."""
    for band in range(parts.shape[0]):
        for k in range(3):
            for i in range(parts.shape[2]):
                for ch in range(parts.shape[3]):
                    grad_lines[k, i, ch] += parts[band, k, i, ch]


def vm_products_backward(points, planes, lines, cotangent, grad_planes, grad_lines):
    """Adjoint of `vm_products`, cotangent [N, 3·C]."""
    bands = bands_of(points, planes.shape[1])
    _products_backward(points, planes, lines, cotangent, True, *bands, grad_planes, grad_lines)


def vm_sum_backward(points, planes, lines, cotangent, least, grad_planes, grad_lines):
    """Adjoint of `vm_sum`, cotangent [N]; those of at most `least` are left out, no numbers are not."""
    bands = bands_of(points, planes.shape[1], np.flatnonzero(~(np.abs(cotangent) <= least)))
    of_all = cotangent.reshape(-1, 1)
    _products_backward(points, planes, lines, of_all, False, *bands, grad_planes, grad_lines)


@kernel
def _products_backward(points, planes, lines, cotangent, each, order, firsts, grad_planes, grad_lines):
    """Cotangents of each product [N, 3·C], or [N, 1] of their sum, which are those of all of them."""
    size, channels, bands = planes.shape[1], planes.shape[3], firsts.shape[1] - 1
    whole = channels - channels % LANES
    parts = np.zeros((bands, 3, size, channels), np.float32)
    for parity in range(2):
        for task in numba.prange(tasks_of(bands, parity)):
            k, band = pair_and_band(task, parity)
            axis = AXIS_A[k]
            part, many = parts[band], eight_of(ZERO)
            for at in range(firsts[axis, band], firsts[axis, band + 1]):
                n = order[axis, at]
                i, j, m, u, v, w = cells_of(points, n, k, size)
                weights, same = corner_weights(u, v), cotangent[n, 0]
                for ch in range(0, whole, LANES):
                    g = load(cotangent, (n, k * channels + ch), many) if each else eight_of(same)
                    spread(planes, lines, grad_planes, part, k, i, j, m, weights, w, ch, g)
                for ch in range(whole, channels):
                    g = cotangent[n, k * channels + ch] if each else same
                    spread(planes, lines, grad_planes, part, k, i, j, m, weights, w, ch, g)
    add_up(parts, grad_lines)


def vm_gradient_backward(points, planes, lines, cotangent, grad_planes, grad_lines):
    """Adjoint of `vm_gradient`, cotangent [N, 3]."""
    bands = bands_of(points, planes.shape[1])
    _gradient_backward(points, planes, lines, cotangent, *bands, grad_planes, grad_lines)


@kernel
def _gradient_backward(points, planes, lines, cotangent, order, firsts, grad_planes, grad_lines):
    size, channels, bands = planes.shape[1], planes.shape[3], firsts.shape[1] - 1
    whole = channels - channels % LANES
    parts = np.zeros((bands, 3, size, channels), np.float32)
    for parity in range(2):
        for task in numba.prange(tasks_of(bands, parity)):
            k, band = pair_and_band(task, parity)
            axis = AXIS_A[k]
            part, many = parts[band], eight_of(ZERO)
            for at in range(firsts[axis, band], firsts[axis, band + 1]):
                n = order[axis, at]
                a = difference_cell(points[n, axis], size)
                b = difference_cell(points[n, AXIS_B[k]], size)
                c = difference_cell(points[n, AXIS_C[k]], size)
                ga = HALF * cotangent[n, axis]
                gb = HALF * cotangent[n, AXIS_B[k]]
                gc = HALF * cotangent[n, AXIS_C[k]]
                for ch in range(0, whole, LANES):
                    spread_differences(planes, lines, grad_planes, part, k, a, b, c, ga, gb, gc, ch, many)
                for ch in range(whole, channels):
                    spread_differences(planes, lines, grad_planes, part, k, a, b, c, ga, gb, gc, ch, ZERO)
    add_up(parts, grad_lines)
