"""Fused CPU kernels for VM lookups; `vm_torch` is their plain twin and describes the layout.

Forward passes share the points among the threads. Backward passes share out the channels instead:
every thread owns its slice of the factors, so no two threads write to one address, no buffers are
reduced afterwards, and the sums come out in the same order on any number of cores.
"""

from __future__ import annotations

import numba
import numpy as np

from .compiling import inlined, kernel, serial_kernel
from .lanes import LANES, load
from .vm_point_numba import (
    ONE,
    cell,
    corner_weights,
    difference_cell,
    differences,
    neighbourhood,
    plane_and_line,
    raw_density,
    spread,
    spread_lanes,
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
    size = planes.shape[1]
    channels = planes.shape[3]
    for n in numba.prange(points.shape[0]):
        for k in range(3):
            i, u = cell(points[n, _axis_a[k]], size)
            j, v = cell(points[n, _axis_b[k]], size)
            m, w = cell(points[n, _axis_c[k]], size)
            weights = corner_weights(u, v)
            for ch in range(channels):
                plane, line = plane_and_line(planes, lines, k, i, j, m, weights, w, ch)
                out[n, k * channels + ch] = plane * line


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
        for n in range(points.shape[0]):
            i, u = cell(points[n, _axis_a[k]], size)
            j, v = cell(points[n, _axis_b[k]], size)
            m, w = cell(points[n, _axis_c[k]], size)
            for ch in range(first, whole, LANES):
                g = load(cotangent[n], k * channels + ch)
                spread_lanes(planes, lines, grad_planes, grad_lines, k, i, j, m, u, v, w, ch, g)
            for ch in range(whole, last):
                g = cotangent[n, k * channels + ch]
                spread(planes, lines, grad_planes, grad_lines, k, i, j, m, u, v, w, ch, g)


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
            same = (g, g, g, g, g, g, g, g)
            for ch in range(first, whole, LANES):
                spread_lanes(planes, lines, grad_planes, grad_lines, k, i, j, m, u, v, w, ch, same)
            for ch in range(whole, last):
                spread(planes, lines, grad_planes, grad_lines, k, i, j, m, u, v, w, ch, g)


@kernel
def vm_gradient(points, planes, lines, out):
    size = planes.shape[1]
    channels = planes.shape[3]
    for n in numba.prange(points.shape[0]):
        out[n, 0] = 0.0
        out[n, 1] = 0.0
        out[n, 2] = 0.0
        for k in range(3):
            i0, i, i3, u = difference_cell(points[n, _axis_a[k]], size)
            j0, j, j3, v = difference_cell(points[n, _axis_b[k]], size)
            m0, m, m3, w = difference_cell(points[n, _axis_c[k]], size)
            near = neighbourhood(planes, lines, k, i0, i, i3, j0, j, j3, m0, m, m3)
            along_a = np.float32(0.0)
            along_b = np.float32(0.0)
            along_c = np.float32(0.0)
            for ch in range(channels):
                value, da, db, line, dc = differences(near, u, v, w, ch)
                along_a += da * line
                along_b += db * line
                along_c += value * dc
            out[n, _axis_a[k]] += np.float32(0.5) * along_a
            out[n, _axis_b[k]] += np.float32(0.5) * along_b
            out[n, _axis_c[k]] += np.float32(0.5) * along_c


def vm_gradient_backward(points, planes, lines, cotangent, grad_planes, grad_lines):
    width = channels_per_task(planes)
    _gradient_backward(points, planes, lines, cotangent, width, grad_planes, grad_lines)


@kernel
def _gradient_backward(points, planes, lines, cotangent, width, grad_planes, grad_lines):
    size = planes.shape[1]
    channels = planes.shape[3]
    for task in numba.prange(task_count(channels, width)):
        k, first, last = task_of(task, channels, width)
        for n in range(points.shape[0]):
            i0, i, i3, u = difference_cell(points[n, _axis_a[k]], size)
            j0, j, j3, v = difference_cell(points[n, _axis_b[k]], size)
            m0, m, m3, w = difference_cell(points[n, _axis_c[k]], size)
            ga = np.float32(0.5) * cotangent[n, _axis_a[k]]
            gb = np.float32(0.5) * cotangent[n, _axis_b[k]]
            gc = np.float32(0.5) * cotangent[n, _axis_c[k]]
            near = neighbourhood(planes, lines, k, i0, i, i3, j0, j, j3, m0, m, m3)
            for ch in range(first, last):
                value, da, db, line, dc = differences(near, u, v, w, ch)
                to_value = gc * dc
                to_a = ga * line
                to_b = gb * line
                to_line = ga * da + gb * db
                to_dc = gc * value
                to_near_a = (ONE - u) * to_a
                to_far_a = u * to_a
                to_near_b = (ONE - v) * to_b
                to_far_b = v * to_b
                low = (ONE - u) * to_value
                high = u * to_value
                grad_planes[k, i, j, ch] += (ONE - v) * (low - to_far_a) - (ONE - u) * to_far_b
                grad_planes[k, i, j + 1, ch] += v * (low - to_far_a) + (ONE - u) * to_near_b
                grad_planes[k, i + 1, j, ch] += (ONE - v) * (high + to_near_a) - u * to_far_b
                grad_planes[k, i + 1, j + 1, ch] += v * (high + to_near_a) + u * to_near_b
                grad_planes[k, i0, j, ch] -= (ONE - v) * to_near_a
                grad_planes[k, i0, j + 1, ch] -= v * to_near_a
                grad_planes[k, i3, j, ch] += (ONE - v) * to_far_a
                grad_planes[k, i3, j + 1, ch] += v * to_far_a
                grad_planes[k, i, j0, ch] -= (ONE - u) * to_near_b
                grad_planes[k, i + 1, j0, ch] -= u * to_near_b
                grad_planes[k, i, j3, ch] += (ONE - u) * to_far_b
                grad_planes[k, i + 1, j3, ch] += u * to_far_b
                grad_lines[k, m, ch] += (ONE - w) * to_line - w * to_dc
                grad_lines[k, m + 1, ch] += w * to_line + (ONE - w) * to_dc
                grad_lines[k, m0, ch] -= (ONE - w) * to_dc
                grad_lines[k, m3, ch] += w * to_dc


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
