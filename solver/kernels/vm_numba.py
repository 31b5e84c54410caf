"""Fused CPU kernels for VM lookups; `vm_torch` is their plain twin and describes the layout.

Forward passes share the points among the threads. Backward passes share out the channels instead:
every thread owns its slice of the factors, so no two threads write to one address, no buffers are
reduced afterwards, and the sums come out in the same order on any number of cores.
"""

from __future__ import annotations

import numba
import numpy as np

from .lanes import LANES, add_to, added, blend, load, multiplied, scaled

ONE = np.float32(1)  # an integer one would make its line double precision, at half the speed

_axis_a = np.array([0, 0, 1])
_axis_b = np.array([1, 2, 2])
_axis_c = np.array([2, 1, 0])


@numba.njit(inline="always", fastmath=True)
def cell(x, size):
    """Lower node and fraction of a linear interpolation on `size` nodes, clamped to the grid."""
    x = min(max(x, np.float32(0.0)), np.float32(size - 1))
    lower = min(int(x), size - 2)
    return lower, np.float32(x - lower)


@numba.njit(inline="always", fastmath=True)
def raw_density(px, py, pz, planes, lines):
    """The VM sum at one point in grid units."""
    size = planes.shape[1]
    channels = planes.shape[3]
    total = np.float32(0.0)
    for k in range(3):
        a = px if k < 2 else py
        b = py if k == 0 else pz
        c = pz if k == 0 else (py if k == 1 else px)
        i, u = cell(a, size)
        j, v = cell(b, size)
        m, w = cell(c, size)
        w00 = (ONE - u) * (ONE - v)
        w01 = (ONE - u) * v
        w10 = u * (ONE - v)
        w11 = u * v
        for ch in range(channels):
            plane = (
                w00 * planes[k, i, j, ch]
                + w01 * planes[k, i, j + 1, ch]
                + w10 * planes[k, i + 1, j, ch]
                + w11 * planes[k, i + 1, j + 1, ch]
            )
            total += plane * ((ONE - w) * lines[k, m, ch] + w * lines[k, m + 1, ch])
    return total


@numba.njit(parallel=True, fastmath=True, cache=True, nogil=True)
def vm_sum(points, planes, lines, out):
    for n in numba.prange(points.shape[0]):
        out[n] = raw_density(points[n, 0], points[n, 1], points[n, 2], planes, lines)


@numba.njit(parallel=True, fastmath=True, cache=True, nogil=True)
def vm_products(points, planes, lines, out):
    size = planes.shape[1]
    channels = planes.shape[3]
    for n in numba.prange(points.shape[0]):
        for k in range(3):
            i, u = cell(points[n, _axis_a[k]], size)
            j, v = cell(points[n, _axis_b[k]], size)
            m, w = cell(points[n, _axis_c[k]], size)
            w00 = (ONE - u) * (ONE - v)
            w01 = (ONE - u) * v
            w10 = u * (ONE - v)
            w11 = u * v
            for ch in range(channels):
                plane = (
                    w00 * planes[k, i, j, ch]
                    + w01 * planes[k, i, j + 1, ch]
                    + w10 * planes[k, i + 1, j, ch]
                    + w11 * planes[k, i + 1, j + 1, ch]
                )
                line = (ONE - w) * lines[k, m, ch] + w * lines[k, m + 1, ch]
                out[n, k * channels + ch] = plane * line


@numba.njit(inline="always", fastmath=True)
def spread(planes, lines, grad_planes, grad_lines, k, i, j, m, u, v, w, ch, g):
    """Add the adjoint of one product of pair k, channel ch, with cotangent g."""
    w00 = (ONE - u) * (ONE - v)
    w01 = (ONE - u) * v
    w10 = u * (ONE - v)
    w11 = u * v
    line = (ONE - w) * lines[k, m, ch] + w * lines[k, m + 1, ch]
    plane = (
        w00 * planes[k, i, j, ch]
        + w01 * planes[k, i, j + 1, ch]
        + w10 * planes[k, i + 1, j, ch]
        + w11 * planes[k, i + 1, j + 1, ch]
    )
    to_plane = g * line
    to_line = g * plane
    grad_planes[k, i, j, ch] += w00 * to_plane
    grad_planes[k, i, j + 1, ch] += w01 * to_plane
    grad_planes[k, i + 1, j, ch] += w10 * to_plane
    grad_planes[k, i + 1, j + 1, ch] += w11 * to_plane
    grad_lines[k, m, ch] += (ONE - w) * to_line
    grad_lines[k, m + 1, ch] += w * to_line


@numba.njit(inline="always", fastmath=True)
def spread_lanes(planes, lines, grad_planes, grad_lines, k, i, j, m, u, v, w, ch, g):
    """`spread` for eight channels from ch on, with their cotangents g."""
    w00 = (ONE - u) * (ONE - v)
    w01 = (ONE - u) * v
    w10 = u * (ONE - v)
    w11 = u * v
    line = blend(ONE - w, load(lines[k, m], ch), w, load(lines[k, m + 1], ch))
    plane = added(
        blend(w00, load(planes[k, i, j], ch), w01, load(planes[k, i, j + 1], ch)),
        blend(w10, load(planes[k, i + 1, j], ch), w11, load(planes[k, i + 1, j + 1], ch)),
    )
    to_plane = multiplied(g, line)
    to_line = multiplied(g, plane)
    add_to(grad_planes[k, i, j], ch, scaled(w00, to_plane))
    add_to(grad_planes[k, i, j + 1], ch, scaled(w01, to_plane))
    add_to(grad_planes[k, i + 1, j], ch, scaled(w10, to_plane))
    add_to(grad_planes[k, i + 1, j + 1], ch, scaled(w11, to_plane))
    add_to(grad_lines[k, m], ch, scaled(ONE - w, to_line))
    add_to(grad_lines[k, m + 1], ch, scaled(w, to_line))


def channels_per_task(planes):
    """Whole rows where there is one thread, so that each cache line is fetched once; else fair shares."""
    return planes.shape[3] if numba.get_num_threads() == 1 else LANES


@numba.njit(inline="always")
def task_of(task, channels, width):
    """Pair and range of channels of a task."""
    tasks_per_pair = (channels + width - 1) // width
    first = (task % tasks_per_pair) * width
    return task // tasks_per_pair, first, min(first + width, channels)


@numba.njit(inline="always")
def task_count(channels, width):
    return 3 * ((channels + width - 1) // width)


def vm_products_backward(points, planes, lines, cotangent, grad_planes, grad_lines):
    """Adjoint of `vm_products`, cotangent [N, 3·C]."""
    width = channels_per_task(planes)
    _products_backward(points, planes, lines, cotangent, width, grad_planes, grad_lines)


@numba.njit(parallel=True, fastmath=True, cache=True, nogil=True)
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


@numba.njit(parallel=True, fastmath=True, cache=True, nogil=True)
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


@numba.njit(inline="always", fastmath=True)
def difference_cell(x, size):
    """`cell` with the nodes before and after it, clamped to the grid."""
    lower, fraction = cell(x, size)
    return max(lower - 1, 0), lower, min(lower + 2, size - 1), fraction


@numba.njit(inline="always", fastmath=True)
def neighbourhood(planes, lines, k, i0, i, i3, j0, j, j3, m0, m, m3):
    """Channels of the twelve plane nodes and the four line nodes that differences look at."""
    return (
        planes[k, i, j], planes[k, i, j + 1], planes[k, i + 1, j], planes[k, i + 1, j + 1],
        planes[k, i0, j], planes[k, i0, j + 1], planes[k, i3, j], planes[k, i3, j + 1],
        planes[k, i, j0], planes[k, i + 1, j0], planes[k, i, j3], planes[k, i + 1, j3],
        lines[k, m], lines[k, m + 1], lines[k, m0], lines[k, m3],
    )  # fmt: skip


@numba.njit(inline="always", fastmath=True)
def differences(near, u, v, w, ch):
    """Plane, its differences along both axes, line and its difference, in one channel.

    The differences are central ones at the nodes, interpolated, and twice as large as they should be.
    """
    (p00, p01, p10, p11, before_a0, before_a1, after_a0, after_a1,
     before_b0, before_b1, after_b0, after_b1, l0, l1, before_c, after_c) = near  # fmt: skip
    low_b = (ONE - u) * p00[ch] + u * p10[ch]
    high_b = (ONE - u) * p01[ch] + u * p11[ch]
    low_a = (ONE - v) * p00[ch] + v * p01[ch]
    high_a = (ONE - v) * p10[ch] + v * p11[ch]
    value = (ONE - v) * low_b + v * high_b
    da = (ONE - u) * (high_a - ((ONE - v) * before_a0[ch] + v * before_a1[ch])) + u * (
        (ONE - v) * after_a0[ch] + v * after_a1[ch] - low_a
    )
    db = (ONE - v) * (high_b - ((ONE - u) * before_b0[ch] + u * before_b1[ch])) + v * (
        (ONE - u) * after_b0[ch] + u * after_b1[ch] - low_b
    )
    line = (ONE - w) * l0[ch] + w * l1[ch]
    dc = (ONE - w) * (l1[ch] - before_c[ch]) + w * (after_c[ch] - l0[ch])
    return value, da, db, line, dc


@numba.njit(parallel=True, fastmath=True, cache=True, nogil=True)
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


@numba.njit(parallel=True, fastmath=True, cache=True, nogil=True)
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


@numba.njit(inline="always")
def mirrored(index, size):
    """An index beyond an axis' ends, reflected there: … b a | a b c …"""
    index = index % (2 * size)
    return 2 * size - 1 - index if index >= size else index


@numba.njit(parallel=True, fastmath=True, cache=True, nogil=True)
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
