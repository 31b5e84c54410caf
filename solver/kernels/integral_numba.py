"""Fused CPU kernels for rectangle means of a map on the sphere; `integral_torch` is their twin.

`table` [H+1, W+1, 3] (double) is the exclusive prefix sum of radiance × row solid angle, `rows`
[H+1] (double) the prefix sum of the row solid angles per texel column. Between texel corners the
tables are bilinear, which is the exact integral of a map that is constant on each texel.
"""

import math

import numba
import numpy as np

from .compiling import function, inlined, kernel, serial_kernel
from .lanes import fetch
from .three_lanes import read, write_columns, write_row
from .vectors_numba import times

BANDS = 8  # of rows; the tasks of a scatter
WORTH_BANDS = 4  # threads: rectangles reach over several bands, whose tasks all compute them


@inlined
def column(x, width, turns_per_column):
    """Whole turns, texel and fraction of a continuous column; columns wrap around."""
    turns = math.floor(x * turns_per_column)
    x -= turns * width
    i = min(int(x), width - 1)
    return turns, i, x - i


@inlined
def corner(table, i, f, j, g):
    """Prefix sums at column i + f and row j + g, and their slopes by column and row."""
    left, below_left = read(table, j, i), read(table, j + 1, i)
    step, below_step = read(table, j, i + 1) - left, read(table, j + 1, i + 1) - below_left
    value = left + f * step
    by_y = below_left + f * below_step - value
    return value + g * by_y, step + g * (below_step - step), by_y


@inlined
def slab(table, width, height, x0, x1, y):
    """Integrals over columns x0..x1 and rows 0..y, y in [0, H]; their slopes by shift, by half the width,
    and by y."""
    turns0, i0, f0 = x0
    turns1, i1, f1 = x1
    j = min(int(y), height - 1)
    g = y - j
    right, right_x, right_y = corner(table, i1, f1, j, g)
    left, left_x, left_y = corner(table, i0, f0, j, g)
    value, by_y = right - left, right_y - left_y
    if turns1 != turns0:
        around = read(table, j, width)
        step = read(table, j + 1, width) - around
        value = value + (turns1 - turns0) * (around + g * step)
        by_y = by_y + (turns1 - turns0) * step
    return value, right_x - left_x, right_x + left_x, by_y


called_slab = function(slab.py_func)
"""`slab` for where rectangles hardly ever are: each place it is put into takes seconds to compile"""


@function
def slab_over_poles(table, width, height, x0, x1, far0, far1, y):
    """`slab` for y in [−H, 2H]: past a pole the map goes on half a turn away (`far`), mirrored."""
    if y < 0.0:
        value, by_x, by_w, by_y = called_slab(table, width, height, far0, far1, -y)
        return -1.0 * value, -1.0 * by_x, -1.0 * by_w, by_y
    if y > height:
        bottom = float(height)
        a, a_x, a_w, _ = called_slab(table, width, height, x0, x1, bottom)
        b, b_x, b_w, _ = called_slab(table, width, height, far0, far1, bottom)
        d, d_x, d_w, by_y = called_slab(table, width, height, far0, far1, 2.0 * height - y)
        return a + b - d, a_x + b_x - d_x, a_w + b_w - d_w, by_y
    return called_slab(table, width, height, x0, x1, y)


@function
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


@function
def rectangle(table, rows, x, y, columns, lines, share, mean, slope, n):
    """Write a share of the mean [n, 3] over a rectangle around (x, y), and of its slopes [n, 3, 4] by x, y,
    columns and lines."""
    height, width = table.shape[0] - 1, table.shape[1] - 1
    per_width = 1.0 / width
    left, right, y0, y1 = x - 0.5 * columns, x + 0.5 * columns, y - 0.5 * lines, y + 0.5 * lines
    x0, x1 = column(left, width, per_width), column(right, width, per_width)
    below, below_slope = row_integral_over_poles(rows, y1, height)
    above, above_slope = row_integral_over_poles(rows, y0, height)
    if y0 >= 0.0 and y1 <= height:
        a, a_x, a_w, a_y = slab(table, width, height, x0, x1, y1)
        b, b_x, b_w, b_y = slab(table, width, height, x0, x1, y0)
    else:
        far0 = column(left + 0.5 * width, width, per_width)
        far1 = column(right + 0.5 * width, width, per_width)
        a, a_x, a_w, a_y = slab_over_poles(table, width, height, x0, x1, far0, far1, y1)
        b, b_x, b_w, b_y = slab_over_poles(table, width, height, x0, x1, far0, far1, y0)
    area = columns * (below - above)
    area_slope = columns * (below_slope - above_slope) / area
    lines_slope = 0.5 * columns * (below_slope + above_slope) / area
    per_area = share / area
    m = per_area * (a - b)
    write_row(mean, n, m)
    write_columns(
        slope, n, per_area * (a_x - b_x), per_area * (a_y - b_y) - area_slope * m,
        0.5 * per_area * (a_w - b_w) - (1.0 / columns) * m,
        0.5 * per_area * (a_y + b_y) - lines_slope * m,
    )  # fmt: skip


@inlined
def fetch_rectangle(table, x, y, columns, lines):
    """Ask for what `rectangle` will read, but for those over a pole or the seam: a few."""
    height, width = table.shape[0] - 1, table.shape[1] - 1
    left, right, y0, y1 = x - 0.5 * columns, x + 0.5 * columns, y - 0.5 * lines, y + 0.5 * lines
    i0, i1 = min(max(int(left), 0), width - 1), min(max(int(right), 0), width - 1)
    j0, j1 = min(max(int(y0), 0), height - 1), min(max(int(y1), 0), height - 1)
    fetch(table, (j0, i0, 0))
    fetch(table, (j0, i1, 0))
    fetch(table, (j0 + 1, i0, 0))
    fetch(table, (j0 + 1, i1, 0))
    fetch(table, (j1, i0, 0))
    fetch(table, (j1, i1, 0))
    fetch(table, (j1 + 1, i0, 0))
    fetch(table, (j1 + 1, i1, 0))


@kernel
def rectangle_mean(table, rows, centre, size, out, slope):
    """Solid-angle weighted means [N, 3] over rectangles, and their slopes [N, 3, 4] by centre and size.

    centre, size [N, 2]: (column, row) in texels.
    """
    for n in numba.prange(centre.shape[0]):
        x, y = float(centre[n, 0]), float(centre[n, 1])
        rectangle(table, rows, x, y, float(size[n, 0]), float(size[n, 1]), 1.0, out, slope, n)


@inlined
def add_triple(values, i, j, f, a):
    """values[i, j] += f·a."""
    values[i, j, 0] += f * a[0]
    values[i, j, 1] += f * a[1]
    values[i, j, 2] += f * a[2]


@inlined
def scatter_row(grad, j, low, high, width, x0, x1, a):
    if j < low or j >= high:
        return
    turns0, i0, f0 = x0
    turns1, i1, f1 = x1
    add_triple(grad, j, i1, 1.0 - f1, a)
    add_triple(grad, j, i1 + 1, f1, a)
    add_triple(grad, j, i0, f0 - 1.0, a)
    add_triple(grad, j, i0 + 1, -f0, a)
    if turns1 != turns0:
        add_triple(grad, j, width, turns1 - turns0, a)


@inlined
def scatter_slab(grad, low, high, width, height, x0, x1, y, a):
    """Adjoint of a `slab` with cotangents a of its integrals."""
    j = min(int(y), height - 1)
    g = y - j
    scatter_row(grad, j, low, high, width, x0, x1, times(1.0 - g, a))
    scatter_row(grad, j + 1, low, high, width, x0, x1, times(g, a))


called_scatter_slab = function(scatter_slab.py_func)
"""see `called_slab`"""


@function
def scatter_over_poles(grad, low, high, width, height, left, right, y, a):
    """Adjoint of `slab_over_poles`."""
    per_width = 1.0 / width
    x0, x1 = column(left, width, per_width), column(right, width, per_width)
    far0 = column(left + 0.5 * width, width, per_width)
    far1 = column(right + 0.5 * width, width, per_width)
    away = (-a[0], -a[1], -a[2])
    if y < 0.0:
        called_scatter_slab(grad, low, high, width, height, far0, far1, -y, away)
    elif y > height:
        bottom = float(height)
        called_scatter_slab(grad, low, high, width, height, x0, x1, bottom, a)
        called_scatter_slab(grad, low, high, width, height, far0, far1, bottom, a)
        called_scatter_slab(grad, low, high, width, height, far0, far1, 2.0 * height - y, away)
    else:
        called_scatter_slab(grad, low, high, width, height, x0, x1, y, a)


@function
def scatter_band(rows, centre, size, cotangent, low, high, grad):
    """Adjoint of all rectangles, as far as it falls into table rows low ≤ j < high."""
    height, width = grad.shape[0] - 1, grad.shape[1] - 1
    per_width = 1.0 / width
    for n in range(centre.shape[0]):
        if cotangent[n, 0] == 0 and cotangent[n, 1] == 0 and cotangent[n, 2] == 0:
            continue
        x, y = float(centre[n, 0]), float(centre[n, 1])
        columns, lines = float(size[n, 0]), float(size[n, 1])
        y0, y1 = y - 0.5 * lines, y + 0.5 * lines
        inside = y0 >= 0.0 and y1 <= height
        if inside and (y1 + 1.0 < low or y0 >= high):
            continue
        below, _ = row_integral_over_poles(rows, y1, height)
        above, _ = row_integral_over_poles(rows, y0, height)
        g = 1.0 / (columns * (below - above))
        left, right = x - 0.5 * columns, x + 0.5 * columns
        a = (g * cotangent[n, 0], g * cotangent[n, 1], g * cotangent[n, 2])
        away = (-a[0], -a[1], -a[2])
        if inside:
            x0, x1 = column(left, width, per_width), column(right, width, per_width)
            scatter_slab(grad, low, high, width, height, x0, x1, y1, a)
            scatter_slab(grad, low, high, width, height, x0, x1, y0, away)
        else:
            scatter_over_poles(grad, low, high, width, height, left, right, y1, a)
            scatter_over_poles(grad, low, high, width, height, left, right, y0, away)


def rectangle_mean_backward(rows, centre, size, cotangent, grad):
    """Adjoint of `rectangle_mean` with respect to `table`; a task owns a band of rows: no collisions."""
    bands = 1 if numba.get_num_threads() < WORTH_BANDS else BANDS
    _scatter(rows, centre, size, cotangent, bands, grad)


@kernel
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


@serial_kernel
def corner_sums(rows, at, share, out):
    """Sums [J, C] of rows [N, C] at places [J, K], each by its share."""
    for j in range(at.shape[0]):
        for c in range(out.shape[1]):
            out[j, c] = 0.0
        for k in range(at.shape[1]):
            for c in range(out.shape[1]):
                out[j, c] += share[j, k] * rows[at[j, k], c]


@serial_kernel
def corner_sums_backward(at, share, cotangent, g_rows):
    """Adjoint of `corner_sums`, added."""
    for j in range(at.shape[0]):
        for k in range(at.shape[1]):
            for c in range(cotangent.shape[1]):
                g_rows[at[j, k], c] += share[j, k] * cotangent[j, c]
