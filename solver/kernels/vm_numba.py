"""Fused CPU kernels for VM lookups; `vm_torch` is their plain twin and describes the layout.

Forward passes share the points among the threads. Backward passes share out the channels instead:
every thread owns its slice of the factors, so no two threads write to one address, no buffers are
reduced afterwards, and the sums come out in the same order on any number of cores.
"""

from __future__ import annotations

import numba
import numpy as np

from .compiling import inlined, kernel, serial_kernel
from .lanes import LANES, eight_of, load, store, total
from .vm_point_numba import (
    HALF,
    ZERO,
    cell,
    corner_weights,
    difference_cell,
    differences,
    plane_and_line,
    raw_density,
    spread,
    spread_differences,
)

_axis_a = np.array([0, 0, 1])
_axis_b = np.array([1, 2, 2])
_axis_c = np.array([2, 1, 0])


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
            i, u = cell(points[n, _axis_a[k]], size)
            j, v = cell(points[n, _axis_b[k]], size)
            m, w = cell(points[n, _axis_c[k]], size)
            weights = corner_weights(u, v)
            for ch in range(0, whole, LANES):
                plane, line = plane_and_line(planes, lines, k, i, j, m, weights, w, ch, many)
                store(out, (n, k * channels + ch), plane * line)
            for ch in range(whole, channels):
                plane, line = plane_and_line(planes, lines, k, i, j, m, weights, w, ch, one)
                store(out, (n, k * channels + ch), plane * line)


def channels_per_task(planes):
    """Whole rows where there is one thread, so that each cache line is fetched once; else fair shares."""
    return planes.shape[3] if numba.get_num_threads() == 1 else LANES


@inlined
def task_of(task, channels, width):
    """Pair and range of channels of a task."""
    tasks_per_pair = (channels + width - 1) // width
    first = (task % tasks_per_pair) * width
    return task // tasks_per_pair, first, min(first + width, channels)


@inlined
def task_count(channels, width):
    return 3 * ((channels + width - 1) // width)


def vm_products_backward(points, planes, lines, cotangent, grad_planes, grad_lines):
    """Adjoint of `vm_products`, cotangent [N, 3·C]."""
    width = channels_per_task(planes)
    _products_backward(points, planes, lines, cotangent, width, grad_planes, grad_lines)


@kernel
def _products_backward(points, planes, lines, cotangent, width, grad_planes, grad_lines):
    size, channels = planes.shape[1], planes.shape[3]
    for task in numba.prange(task_count(channels, width)):
        k, first, last = task_of(task, channels, width)
        whole = last - (last - first) % LANES
        many, one = eight_of(ZERO), ZERO
        for n in range(points.shape[0]):
            i, u = cell(points[n, _axis_a[k]], size)
            j, v = cell(points[n, _axis_b[k]], size)
            m, w = cell(points[n, _axis_c[k]], size)
            weights = corner_weights(u, v)
            for ch in range(first, whole, LANES):
                g = load(cotangent, (n, k * channels + ch), many)
                spread(planes, lines, grad_planes, grad_lines, k, i, j, m, weights, w, ch, g)
            for ch in range(whole, last):
                g = load(cotangent, (n, k * channels + ch), one)
                spread(planes, lines, grad_planes, grad_lines, k, i, j, m, weights, w, ch, g)


def vm_sum_backward(points, planes, lines, cotangent, least, grad_planes, grad_lines):
    """Adjoint of `vm_sum`, cotangent [N]; those of at most `least` are left out."""
    width = channels_per_task(planes)
    _sum_backward(points, planes, lines, cotangent, least, width, grad_planes, grad_lines)


@kernel
def _sum_backward(points, planes, lines, cotangent, least, width, grad_planes, grad_lines):
    size, channels = planes.shape[1], planes.shape[3]
    for task in numba.prange(task_count(channels, width)):
        k, first, last = task_of(task, channels, width)
        whole = last - (last - first) % LANES
        for n in range(points.shape[0]):
            g = cotangent[n]
            if abs(g) <= least:
                continue
            i, u = cell(points[n, _axis_a[k]], size)
            j, v = cell(points[n, _axis_b[k]], size)
            m, w = cell(points[n, _axis_c[k]], size)
            weights = corner_weights(u, v)
            for ch in range(first, whole, LANES):
                same = eight_of(g)
                spread(planes, lines, grad_planes, grad_lines, k, i, j, m, weights, w, ch, same)
            for ch in range(whole, last):
                spread(planes, lines, grad_planes, grad_lines, k, i, j, m, weights, w, ch, g)


@kernel
def vm_gradient(points, planes, lines, out):
    size, channels = planes.shape[1], planes.shape[3]
    whole = channels - channels % LANES
    for n in numba.prange(points.shape[0]):
        out[n, 0] = 0.0
        out[n, 1] = 0.0
        out[n, 2] = 0.0
        for k in range(3):
            a = difference_cell(points[n, _axis_a[k]], size)
            b = difference_cell(points[n, _axis_b[k]], size)
            c = difference_cell(points[n, _axis_c[k]], size)
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
            out[n, _axis_a[k]] += HALF * (total(sum_a) + along_a)
            out[n, _axis_b[k]] += HALF * (total(sum_b) + along_b)
            out[n, _axis_c[k]] += HALF * (total(sum_c) + along_c)


def vm_gradient_backward(points, planes, lines, cotangent, grad_planes, grad_lines):
    """Adjoint of `vm_gradient`, cotangent [N, 3]."""
    width = channels_per_task(planes)
    _gradient_backward(points, planes, lines, cotangent, width, grad_planes, grad_lines)


@kernel
def _gradient_backward(points, planes, lines, cotangent, width, grad_planes, grad_lines):
    size, channels = planes.shape[1], planes.shape[3]
    for task in numba.prange(task_count(channels, width)):
        k, first, last = task_of(task, channels, width)
        whole = last - (last - first) % LANES
        many = eight_of(ZERO)
        for n in range(points.shape[0]):
            a = difference_cell(points[n, _axis_a[k]], size)
            b = difference_cell(points[n, _axis_b[k]], size)
            c = difference_cell(points[n, _axis_c[k]], size)
            ga = HALF * cotangent[n, _axis_a[k]]
            gb = HALF * cotangent[n, _axis_b[k]]
            gc = HALF * cotangent[n, _axis_c[k]]
            for ch in range(first, whole, LANES):
                spread_differences(
                    planes, lines, grad_planes, grad_lines, k, a, b, c, ga, gb, gc, ch, many
                )  # fmt: skip
            for ch in range(whole, last):
                spread_differences(
                    planes, lines, grad_planes, grad_lines, k, a, b, c, ga, gb, gc, ch, ZERO
                )  # fmt: skip


@inlined
def mirrored(index, size):
    """An index beyond an axis' ends, reflected there: … b a | a b c …"""
    index = index % (2 * size)
    return 2 * size - 1 - index if index >= size else index


@kernel
def smooth_planes(planes, taps, out):
    """Odd, symmetric taps along both axes of planes [3, G, G, C], borders mirrored.

    The operator is symmetric, so it is its own adjoint.
    """
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
        for c in range(row):
            into[c] = middle * inner[c]
        for away in range(1, reach + 1):
            weight = taps[reach + away]
            low, high = line[(reach - away) * channels :], line[(reach + away) * channels :]
            for c in range(row):
                into[c] += weight * (low[c] + high[c])


@serial_kernel
def smooth_lines(lines, taps, out):
    """Odd, symmetric taps along lines [3, G, C], borders mirrored."""
    size, channels, reach = lines.shape[1], lines.shape[2], len(taps) // 2
    for k in range(3):
        for i in range(size):
            for c in range(channels):
                out[k, i, c] = taps[reach] * lines[k, i, c]
            for away in range(1, reach + 1):
                weight = taps[reach + away]
                before, after = mirrored(i - away, size), mirrored(i + away, size)
                for c in range(channels):
                    out[k, i, c] += weight * (lines[k, before, c] + lines[k, after, c])
