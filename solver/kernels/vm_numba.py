"""Fused CPU kernels for VM lookups; `vm_torch` is their plain twin and describes the layout.

They share the points among the threads. Their adjoints are in `vm_adjoint_numba`.
"""

import numba
import numpy as np

from .compiling import inlined, kernel, serial_kernel
from .lanes import LANES, eight_of, store, total
from .vm_adjoint_numba import vm_gradient_backward, vm_products_backward, vm_sum_backward  # noqa: F401
from .vm_point_numba import (
    AXIS_A,
    AXIS_B,
    AXIS_C,
    HALF,
    ZERO,
    cells_of,
    corner_weights,
    difference_cell,
    differences,
    plane_and_line,
    raw_density,
)


@kernel
def vm_sum(points, planes, lines, out):
    for n in numba.prange(points.shape[0]):
        out[n] = raw_density(points[n, 0], points[n, 1], points[n, 2], planes, lines)


@kernel
def vm_products(points, planes, lines, out):
    size, channels = planes.shape[1], planes.shape[3]
    whole = channels - channels % LANES
    for n in numba.prange(points.shape[0]):
        many, one = eight_of(ZERO), ZERO
        for k in range(3):
            i, j, m, u, v, w = cells_of(points, n, k, size)
            weights = corner_weights(u, v)
            for ch in range(0, whole, LANES):
                plane, line = plane_and_line(planes, lines, k, i, j, m, weights, w, ch, many)
                store(out, (n, k * channels + ch), plane * line)
            for ch in range(whole, channels):
                plane, line = plane_and_line(planes, lines, k, i, j, m, weights, w, ch, one)
                store(out, (n, k * channels + ch), plane * line)


@kernel
def vm_gradient(points, planes, lines, out):
    size, channels = planes.shape[1], planes.shape[3]
    whole = channels - channels % LANES
    for n in numba.prange(points.shape[0]):
        out[n, 0] = 0.0
        out[n, 1] = 0.0
        out[n, 2] = 0.0
        for k in range(3):
            a = difference_cell(points[n, AXIS_A[k]], size)
            b = difference_cell(points[n, AXIS_B[k]], size)
            c = difference_cell(points[n, AXIS_C[k]], size)
            many, along_a, along_b, along_c = eight_of(ZERO), ZERO, ZERO, ZERO
            sum_a, sum_b, sum_c = many, many, many
            for ch in range(0, whole, LANES):
                value, by_a, by_b, line, by_c = differences(planes, lines, k, a, b, c, ch, many)
                sum_a = sum_a + by_a * line
                sum_b = sum_b + by_b * line
                sum_c = sum_c + value * by_c
            for ch in range(whole, channels):
                value, by_a, by_b, line, by_c = differences(planes, lines, k, a, b, c, ch, ZERO)
                along_a += by_a * line
                along_b += by_b * line
                along_c += value * by_c
            out[n, AXIS_A[k]] += HALF * (total(sum_a) + along_a)
            out[n, AXIS_B[k]] += HALF * (total(sum_b) + along_b)
            out[n, AXIS_C[k]] += HALF * (total(sum_c) + along_c)


@inlined
def mirrored(index, size):
    """An index beyond an axis' ends, reflected there: … b a | a b c …"""
    index = index % (2 * size)
    return 2 * size - 1 - index if index >= size else index


def smooth_planes(planes, taps, out):
    """Odd, symmetric taps along both axes of planes [3, G, G, C], borders mirrored.

    The operator is symmetric, so it is its own adjoint.
    """
    _smooth_planes(planes, taps, False, out)


def add_smooth_planes(planes, taps, out):
    """out += what `smooth_planes` writes."""
    _smooth_planes(planes, taps, True, out)


@kernel
def _smooth_planes(planes, taps, added, out):
    size, channels, reach = planes.shape[1], planes.shape[3], len(taps) // 2
    row = size * channels
    for task in numba.prange(3 * size):
        k, i = task // size, task % size
        line = np.empty(row + 2 * reach * channels, np.float32)
        inner = line[reach * channels : reach * channels + row]
        here, middle = planes[k, i].ravel(), taps[reach]
        for c in range(row):
            inner[c] = middle * here[c]
        for away in range(1, reach + 1):
            weight = taps[reach + away]
            before = planes[k, mirrored(i - away, size)].ravel()
            after = planes[k, mirrored(i + away, size)].ravel()
            for c in range(row):
                inner[c] += weight * (before[c] + after[c])
        for beyond in range(reach):
            left = mirrored(-1 - beyond, size) * channels
            right = mirrored(size + beyond, size) * channels
            for c in range(channels):
                line[(reach - 1 - beyond) * channels + c] = inner[left + c]
                line[(reach + size + beyond) * channels + c] = inner[right + c]
        into = out[k, i].ravel()
        if not added:
            into[:] = 0.0
        for c in range(row):
            into[c] += middle * inner[c]
        for away in range(1, reach + 1):
            weight = taps[reach + away]
            low, high = line[(reach - away) * channels :], line[(reach + away) * channels :]
            for c in range(row):
                into[c] += weight * (low[c] + high[c])


def smooth_lines(lines, taps, out):
    """Odd, symmetric taps along lines [3, G, C], borders mirrored."""
    _smooth_lines(lines, taps, False, out)


def add_smooth_lines(lines, taps, out):
    """out += what `smooth_lines` writes."""
    _smooth_lines(lines, taps, True, out)


@serial_kernel
def _smooth_lines(lines, taps, added, out):
    size, channels, reach = lines.shape[1], lines.shape[2], len(taps) // 2
    for k in range(3):
        for i in range(size):
            if not added:
                out[k, i] = 0.0
            for c in range(channels):
                out[k, i, c] += taps[reach] * lines[k, i, c]
            for away in range(1, reach + 1):
                weight = taps[reach + away]
                before, after = mirrored(i - away, size), mirrored(i + away, size)
                for c in range(channels):
                    out[k, i, c] += weight * (lines[k, before, c] + lines[k, after, c])
