"""Fused CPU kernels for rectangle means of a map on the sphere; `integral_torch` is their twin.

`table` [H+1, W+1, 3] (double) is the exclusive prefix sum of radiance × row solid angle, `rows`
[H+1] (double) the prefix sum of the row solid angles per texel column. Between texel corners the
tables are bilinear, which is the exact integral of a map that is constant on each texel.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from .vectors_numba import minus, plus, triple

BANDS = 8  # of rows; the tasks of a scatter, where several threads share it


@numba.njit(fastmath=True)
def column(x, width):
    """Whole turns, texel and fraction of a continuous column; columns wrap around."""
    turns = math.floor(x / width)
    x -= turns * width
    i = min(int(x), width - 1)
    return turns, i, x - i


@numba.njit(fastmath=True)
def row_terms(table, j, width, x0, x1):
    """Prefix sums [3] of table row j between columns x0 and x1, and their slopes by x1 and by x0."""
    turns0, i0, f0 = x0
    turns1, i1, f1 = x1
    left, right = triple(table, j, i0), triple(table, j, i1)
    step0 = minus(triple(table, j, i0 + 1), left)
    step1 = minus(triple(table, j, i1 + 1), right)
    between = plus(plus(minus(right, left), f1, step1), -f0, step0)
    if turns1 != turns0:
        between = plus(between, turns1 - turns0, triple(table, j, width))
    return between, step1, step0


@numba.njit(fastmath=True)
def slab(table, width, height, x0, x1, y):
    """Integrals [3] over columns x0..x1 and rows 0..y, y in [0, H]; their slopes by y, x1 and x0."""
    j = min(int(y), height - 1)
    f = y - j
    top, top1, top0 = row_terms(table, j, width, x0, x1)
    bottom, bottom1, bottom0 = row_terms(table, j + 1, width, x0, x1)
    by_y = minus(bottom, top)
    by_1 = plus(top1, f, minus(bottom1, top1))
    by_0 = plus(top0, f, minus(bottom0, top0))
    return plus(top, f, by_y), by_y, by_1, by_0


@numba.njit(fastmath=True)
def slab_over_poles(table, width, height, x0, x1, far0, far1, y):
    """`slab` for y in [−H, 2H]: past a pole the map goes on half a turn away (`far`), mirrored."""
    zero = (0.0, 0.0, 0.0)
    if y < 0.0:
        value, by_y, by_1, by_0 = slab(table, width, height, far0, far1, -y)
        return minus(zero, value), by_y, minus(zero, by_1), minus(zero, by_0)
    if y > height:
        bottom = float(height)
        a, _, a1, a0 = slab(table, width, height, x0, x1, bottom)
        b, _, b1, b0 = slab(table, width, height, far0, far1, bottom)
        d, by_y, d1, d0 = slab(table, width, height, far0, far1, 2.0 * height - y)
        return (
            minus(plus(a, 1.0, b), d), by_y, minus(plus(a1, 1.0, b1), d1),
            minus(plus(a0, 1.0, b0), d0),
        )  # fmt: skip
    return slab(table, width, height, x0, x1, y)


@numba.njit(fastmath=True)
def row_integral_over_poles(rows, y, height):
    """Solid angle of one texel column between row 0 and continuous row y; its slope by y."""
    folded = -y if y < 0.0 else (2.0 * height - y if y > height else y)
    j = min(int(folded), height - 1)
    slope = rows[j + 1] - rows[j]
    value = rows[j] + (folded - j) * slope
    if y < 0.0:
        return -value, slope
    if y > height:
        return 2.0 * rows[height] - value, slope
    return value, slope


@numba.njit(fastmath=True)
def rectangle(table, rows, x, y, columns, lines, mean, slope, n):
    """Write the mean [n, 3] over a rectangle around (x, y), and its slopes [n, 3, 2] by x and y."""
    height, width = table.shape[0] - 1, table.shape[1] - 1
    left, right, y0, y1 = x - 0.5 * columns, x + 0.5 * columns, y - 0.5 * lines, y + 0.5 * lines
    x0, x1 = column(left, width), column(right, width)
    far0, far1 = column(left + 0.5 * width, width), column(right + 0.5 * width, width)
    below, below_slope = row_integral_over_poles(rows, y1, height)
    above, above_slope = row_integral_over_poles(rows, y0, height)
    per_area = 1.0 / (columns * (below - above))
    area_slope = columns * (below_slope - above_slope)
    a, a_y, a_1, a_0 = slab_over_poles(table, width, height, x0, x1, far0, far1, y1)
    b, b_y, b_1, b_0 = slab_over_poles(table, width, height, x0, x1, far0, far1, y0)
    by_x = minus(minus(a_1, b_1), minus(a_0, b_0))
    value, by_y = minus(a, b), minus(a_y, b_y)
    for c in range(3):
        mean[n, c] = per_area * value[c]
        slope[n, c, 0] = per_area * by_x[c]
        slope[n, c, 1] = per_area * (by_y[c] - per_area * value[c] * area_slope)


@numba.njit(parallel=True, fastmath=True, cache=True, nogil=True)
def rectangle_mean(table, rows, centre, size, out, slope):
    """Solid-angle weighted means [N, 3] over rectangles, and their slopes [N, 3, 2] by centre.

    centre, size [N, 2]: (column, row) in texels.
    """
    for n in numba.prange(centre.shape[0]):
        x, y = float(centre[n, 0]), float(centre[n, 1])
        rectangle(table, rows, x, y, float(size[n, 0]), float(size[n, 1]), out, slope, n)


@numba.njit(fastmath=True)
def scatter_row(grad, j, low, high, width, x0, x1, g, cotangent, n):
    if j < low or j >= high:
        return
    turns0, i0, f0 = x0
    turns1, i1, f1 = x1
    for c in range(3):
        value = g * cotangent[n, c]
        grad[j, width, c] += (turns1 - turns0) * value
        grad[j, i1, c] += (1.0 - f1) * value
        grad[j, i1 + 1, c] += f1 * value
        grad[j, i0, c] -= (1.0 - f0) * value
        grad[j, i0 + 1, c] -= f0 * value


@numba.njit(fastmath=True)
def scatter_slab(grad, low, high, width, height, x0, x1, y, g, cotangent, n):
    j = min(int(y), height - 1)
    f = y - j
    scatter_row(grad, j, low, high, width, x0, x1, (1.0 - f) * g, cotangent, n)
    scatter_row(grad, j + 1, low, high, width, x0, x1, f * g, cotangent, n)


@numba.njit(fastmath=True)
def scatter_over_poles(grad, low, high, width, height, left, right, x0, x1, y, g, cotangent, n):
    if 0.0 <= y <= height:
        scatter_slab(grad, low, high, width, height, x0, x1, y, g, cotangent, n)
        return
    far0, far1 = column(left + 0.5 * width, width), column(right + 0.5 * width, width)
    if y < 0.0:
        scatter_slab(grad, low, high, width, height, far0, far1, -y, -g, cotangent, n)
        return
    bottom = float(height)
    scatter_slab(grad, low, high, width, height, x0, x1, bottom, g, cotangent, n)
    scatter_slab(grad, low, high, width, height, far0, far1, bottom, g, cotangent, n)
    mirrored = 2.0 * height - y
    scatter_slab(grad, low, high, width, height, far0, far1, mirrored, -g, cotangent, n)


@numba.njit(fastmath=True, nogil=True)
def scatter_band(rows, centre, size, cotangent, low, high, grad):
    """Adjoint of all rectangles, as far as it falls into table rows low ≤ j < high."""
    height, width = grad.shape[0] - 1, grad.shape[1] - 1
    for n in range(centre.shape[0]):
        if cotangent[n, 0] == 0 and cotangent[n, 1] == 0 and cotangent[n, 2] == 0:
            continue
        x, y = float(centre[n, 0]), float(centre[n, 1])
        columns, lines = float(size[n, 0]), float(size[n, 1])
        y0, y1 = y - 0.5 * lines, y + 0.5 * lines
        if y0 >= 0.0 and y1 <= height and (y1 + 1.0 < low or y0 >= high):
            continue
        below, _ = row_integral_over_poles(rows, y1, height)
        above, _ = row_integral_over_poles(rows, y0, height)
        g = 1.0 / (columns * (below - above))
        left, right = x - 0.5 * columns, x + 0.5 * columns
        x0, x1 = column(left, width), column(right, width)
        for y, sign in ((y1, g), (y0, -g)):
            scatter_over_poles(
                grad, low, high, width, height, left, right, x0, x1, y, sign, cotangent, n
            )


def rectangle_mean_backward(rows, centre, size, cotangent, grad):
    """Adjoint of `rectangle_mean` with respect to `table`; a task owns a band of rows: no collisions."""
    bands = 1 if numba.get_num_threads() == 1 else BANDS
    _scatter(rows, centre, size, cotangent, bands, grad)


@numba.njit(parallel=True, fastmath=True, cache=True, nogil=True)
def _scatter(rows, centre, size, cotangent, bands, grad):
    count = grad.shape[0]
    for band in numba.prange(bands):
        low, high = band * count // bands, (band + 1) * count // bands
        scatter_band(rows, centre, size, cotangent, low, high, grad)


@numba.njit(cache=True, nogil=True)
def prefix_sums(values, row_weights, table):
    """Exclusive prefix sums [H+1, W+1, 3] double of values [3, H, W] times a weight a row."""
    height, width = values.shape[1], values.shape[2]
    table[0] = 0.0
    for i in range(height):
        table[i + 1, 0] = 0.0
        running0, running1, running2 = 0.0, 0.0, 0.0
        for j in range(width):
            running0 += values[0, i, j] * row_weights[i]
            running1 += values[1, i, j] * row_weights[i]
            running2 += values[2, i, j] * row_weights[i]
            table[i + 1, j + 1, 0] = table[i, j + 1, 0] + running0
            table[i + 1, j + 1, 1] = table[i, j + 1, 1] + running1
            table[i + 1, j + 1, 2] = table[i, j + 1, 2] + running2


@numba.njit(cache=True, nogil=True)
def prefix_sums_backward(cotangent, row_weights, out):
    """Adjoint of `prefix_sums`: sums over all entries below and to the right."""
    height, width = out.shape[1], out.shape[2]
    below = np.zeros((width, 3))
    for i in range(height - 1, -1, -1):
        running0, running1, running2 = 0.0, 0.0, 0.0
        for j in range(width - 1, -1, -1):
            running0 += cotangent[i + 1, j + 1, 0]
            running1 += cotangent[i + 1, j + 1, 1]
            running2 += cotangent[i + 1, j + 1, 2]
            below[j, 0] += running0
            below[j, 1] += running1
            below[j, 2] += running2
            out[0, i, j] = below[j, 0] * row_weights[i]
            out[1, i, j] = below[j, 1] * row_weights[i]
            out[2, i, j] = below[j, 2] * row_weights[i]
