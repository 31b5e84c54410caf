"""Fused CPU kernels for rectangle means of a map on the sphere; `integral_torch` is their twin.

`table` [3, H+1, W+1] (double) is the exclusive prefix sum of radiance × row solid angle, `rows`
[H+1] (double) the prefix sum of the row solid angles per texel column. Between texel corners the
tables are bilinear, which is the exact integral of a map that is constant on each texel.
"""

from __future__ import annotations

import math

import numba
import numpy as np


@numba.njit(inline="always")
def prefix_x(table, channel, row, x, width):
    """Prefix sum at table row `row` and continuous column x; periodic columns wrap around."""
    turns = math.floor(x / width)
    x -= turns * width
    i = min(int(x), width - 1)
    f = x - i
    left = table[channel, row, i]
    return turns * table[channel, row, width] + left + f * (table[channel, row, i + 1] - left)


@numba.njit(inline="always")
def slab(table, channel, x0, x1, y, width, height):
    """Integral over columns x0..x1 and rows 0..y for y in [0, H]."""
    j = min(int(y), height - 1)
    f = y - j
    top = prefix_x(table, channel, j, x1, width) - prefix_x(table, channel, j, x0, width)
    bottom = prefix_x(table, channel, j + 1, x1, width) - prefix_x(table, channel, j + 1, x0, width)
    return top + f * (bottom - top)


@numba.njit(inline="always")
def slab_over_poles(table, channel, x0, x1, y, width, height):
    """`slab` for y in [−H, 2H]: past a pole the map goes on half a turn away, mirrored."""
    half = 0.5 * width
    if y < 0.0:
        return -slab(table, channel, x0 + half, x1 + half, -y, width, height)
    if y > height:
        whole = slab(table, channel, x0, x1, height, width, height)
        mirrored = slab(table, channel, x0 + half, x1 + half, height, width, height)
        beyond = slab(table, channel, x0 + half, x1 + half, 2.0 * height - y, width, height)
        return whole + mirrored - beyond
    return slab(table, channel, x0, x1, y, width, height)


@numba.njit(inline="always")
def row_integral(rows, y, height):
    """Solid angle of one texel column between row 0 and continuous row y in [0, H]."""
    j = min(int(y), height - 1)
    return rows[j] + (y - j) * (rows[j + 1] - rows[j])


@numba.njit(inline="always")
def row_integral_over_poles(rows, y, height):
    if y < 0.0:
        return -row_integral(rows, -y, height)
    if y > height:
        return 2.0 * rows[height] - row_integral(rows, 2.0 * height - y, height)
    return row_integral(rows, y, height)


@numba.njit(inline="always")
def row_density(rows, y, height):
    """Derivative of `row_integral_over_poles`: the solid angle of a texel in the row of y."""
    if y < 0.0:
        y = -y
    if y > height:
        y = 2.0 * height - y
    j = min(int(y), height - 1)
    return rows[j + 1] - rows[j]


@numba.njit(inline="always")
def edge_y(table, channel, x0, x1, y, width, height):
    """Derivative of `slab_over_poles` with respect to y."""
    if y < 0.0:
        y = -y
        x0 += 0.5 * width
        x1 += 0.5 * width
    elif y > height:
        y = 2.0 * height - y
        x0 += 0.5 * width
        x1 += 0.5 * width
    j = min(int(y), height - 1)
    bottom = prefix_x(table, channel, j + 1, x1, width) - prefix_x(table, channel, j + 1, x0, width)
    return bottom - (
        prefix_x(table, channel, j, x1, width) - prefix_x(table, channel, j, x0, width)
    )


@numba.njit(inline="always")
def column_density(table, channel, x, row, width):
    """Derivative of `prefix_x` with respect to x."""
    x -= math.floor(x / width) * width
    i = min(int(x), width - 1)
    return table[channel, row, i + 1] - table[channel, row, i]


@numba.njit(inline="always")
def column_slab(table, channel, x, y, width, height):
    """Derivative of `slab` with respect to one column bound, for y in [0, H]."""
    j = min(int(y), height - 1)
    top = column_density(table, channel, x, j, width)
    return top + (y - j) * (column_density(table, channel, x, j + 1, width) - top)


@numba.njit(inline="always")
def edge_x(table, channel, x, y, width, height):
    half = 0.5 * width
    if y < 0.0:
        return -column_slab(table, channel, x + half, -y, width, height)
    if y > height:
        return (
            column_slab(table, channel, x, height, width, height)
            + column_slab(table, channel, x + half, height, width, height)
            - column_slab(table, channel, x + half, 2.0 * height - y, width, height)
        )
    return column_slab(table, channel, x, y, width, height)


@numba.njit(parallel=True, cache=True, nogil=True)
def rectangle_mean(table, rows, centre, size, out, slope):
    """Solid-angle weighted means [N, 3] over rectangles, and their slopes [N, 3, 2] by centre.

    centre, size [N, 2]: (column, row) in texels.
    """
    height, width = table.shape[1] - 1, table.shape[2] - 1
    for n in numba.prange(centre.shape[0]):
        x0, x1 = centre[n, 0] - 0.5 * size[n, 0], centre[n, 0] + 0.5 * size[n, 0]
        y0, y1 = centre[n, 1] - 0.5 * size[n, 1], centre[n, 1] + 0.5 * size[n, 1]
        columns = x1 - x0
        area = columns * (
            row_integral_over_poles(rows, y1, height) - row_integral_over_poles(rows, y0, height)
        )
        area_slope = columns * (row_density(rows, y1, height) - row_density(rows, y0, height))
        for c in range(3):
            total = slab_over_poles(table, c, x0, x1, y1, width, height) - slab_over_poles(
                table, c, x0, x1, y0, width, height
            )
            mean = total / area
            out[n, c] = mean
            right = edge_x(table, c, x1, y1, width, height) - edge_x(
                table, c, x1, y0, width, height
            )
            left = edge_x(table, c, x0, y1, width, height) - edge_x(table, c, x0, y0, width, height)
            slope[n, c, 0] = (right - left) / area
            rise = edge_y(table, c, x0, x1, y1, width, height) - edge_y(
                table, c, x0, x1, y0, width, height
            )
            slope[n, c, 1] = (rise - mean * area_slope) / area


@numba.njit(inline="always")
def scatter_x(grad, channel, row, x, width, g):
    turns = math.floor(x / width)
    x -= turns * width
    i = min(int(x), width - 1)
    f = x - i
    grad[channel, row, width] += turns * g
    grad[channel, row, i] += (1.0 - f) * g
    grad[channel, row, i + 1] += f * g


@numba.njit(inline="always")
def scatter_slab(grad, channel, x0, x1, y, width, height, g):
    j = min(int(y), height - 1)
    f = y - j
    scatter_x(grad, channel, j, x1, width, (1.0 - f) * g)
    scatter_x(grad, channel, j, x0, width, -(1.0 - f) * g)
    scatter_x(grad, channel, j + 1, x1, width, f * g)
    scatter_x(grad, channel, j + 1, x0, width, -f * g)


@numba.njit(inline="always")
def scatter_over_poles(grad, channel, x0, x1, y, width, height, g):
    half = 0.5 * width
    if y < 0.0:
        scatter_slab(grad, channel, x0 + half, x1 + half, -y, width, height, -g)
    elif y > height:
        scatter_slab(grad, channel, x0, x1, np.float64(height), width, height, g)
        scatter_slab(grad, channel, x0 + half, x1 + half, np.float64(height), width, height, g)
        scatter_slab(grad, channel, x0 + half, x1 + half, 2.0 * height - y, width, height, -g)
    else:
        scatter_slab(grad, channel, x0, x1, y, width, height, g)


@numba.njit(parallel=True, cache=True, nogil=True)
def rectangle_mean_backward(rows, centre, size, cotangent, grad):
    """Adjoint of `rectangle_mean` with respect to `table`; one thread a channel, no collisions."""
    height, width = grad.shape[1] - 1, grad.shape[2] - 1
    for c in numba.prange(3):
        for n in range(centre.shape[0]):
            x0, x1 = centre[n, 0] - 0.5 * size[n, 0], centre[n, 0] + 0.5 * size[n, 0]
            y0, y1 = centre[n, 1] - 0.5 * size[n, 1], centre[n, 1] + 0.5 * size[n, 1]
            area = (x1 - x0) * (
                row_integral_over_poles(rows, y1, height)
                - row_integral_over_poles(rows, y0, height)
            )
            g = cotangent[n, c] / area
            scatter_over_poles(grad, c, x0, x1, y1, width, height, g)
            scatter_over_poles(grad, c, x0, x1, y0, width, height, -g)


@numba.njit(parallel=True, cache=True, nogil=True)
def prefix_sums(values, row_weights, table):
    """Exclusive prefix sums [3, H+1, W+1] double of values [3, H, W] times a weight a row."""
    height, width = values.shape[1], values.shape[2]
    for c in numba.prange(3):
        table[c, 0, :] = 0.0
        for i in range(height):
            running = 0.0
            table[c, i + 1, 0] = 0.0
            for j in range(width):
                running += values[c, i, j] * row_weights[i]
                table[c, i + 1, j + 1] = table[c, i, j + 1] + running


@numba.njit(parallel=True, cache=True, nogil=True)
def prefix_sums_backward(cotangent, row_weights, out):
    """Adjoint of `prefix_sums`: sums over all entries below and to the right."""
    height, width = out.shape[1], out.shape[2]
    for c in numba.prange(3):
        below = np.zeros(width)
        for i in range(height - 1, -1, -1):
            running = 0.0
            for j in range(width - 1, -1, -1):
                running += cotangent[c, i + 1, j + 1]
                below[j] += running
                out[c, i, j] = below[j] * row_weights[i]
