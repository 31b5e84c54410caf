"""Fused CPU kernels for VM lookups; `vm_torch` is their plain twin and describes the layout.

Forward passes share the points among the threads. Backward passes share out the channels instead:
every thread owns its slice of the factors, so no two threads write to one address, no buffers are
reduced afterwards, and the sums come out in the same order on any number of cores.
"""

from __future__ import annotations

import numba
import numpy as np

CHANNELS_PER_TASK = 8

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
        w00 = (1 - u) * (1 - v)
        w01 = (1 - u) * v
        w10 = u * (1 - v)
        w11 = u * v
        for ch in range(channels):
            plane = (
                w00 * planes[k, i, j, ch]
                + w01 * planes[k, i, j + 1, ch]
                + w10 * planes[k, i + 1, j, ch]
                + w11 * planes[k, i + 1, j + 1, ch]
            )
            total += plane * ((1 - w) * lines[k, m, ch] + w * lines[k, m + 1, ch])
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
            w00 = (1 - u) * (1 - v)
            w01 = (1 - u) * v
            w10 = u * (1 - v)
            w11 = u * v
            for ch in range(channels):
                plane = (
                    w00 * planes[k, i, j, ch]
                    + w01 * planes[k, i, j + 1, ch]
                    + w10 * planes[k, i + 1, j, ch]
                    + w11 * planes[k, i + 1, j + 1, ch]
                )
                line = (1 - w) * lines[k, m, ch] + w * lines[k, m + 1, ch]
                out[n, k * channels + ch] = plane * line


@numba.njit(parallel=True, fastmath=True, cache=True, nogil=True)
def vm_products_backward(points, planes, lines, cotangent, stride, grad_planes, grad_lines):
    """Adjoint of `vm_products` (stride 1) and of `vm_sum` (stride 0: one cotangent for all)."""
    size = planes.shape[1]
    channels = planes.shape[3]
    tasks_per_pair = (channels + CHANNELS_PER_TASK - 1) // CHANNELS_PER_TASK
    for task in numba.prange(3 * tasks_per_pair):
        k = task // tasks_per_pair
        first = (task % tasks_per_pair) * CHANNELS_PER_TASK
        last = min(first + CHANNELS_PER_TASK, channels)
        for n in range(points.shape[0]):
            i, u = cell(points[n, _axis_a[k]], size)
            j, v = cell(points[n, _axis_b[k]], size)
            m, w = cell(points[n, _axis_c[k]], size)
            w00 = (1 - u) * (1 - v)
            w01 = (1 - u) * v
            w10 = u * (1 - v)
            w11 = u * v
            for ch in range(first, last):
                g = cotangent[n, (k * channels + ch) * stride]
                line = (1 - w) * lines[k, m, ch] + w * lines[k, m + 1, ch]
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
                grad_lines[k, m, ch] += (1 - w) * to_line
                grad_lines[k, m + 1, ch] += w * to_line


@numba.njit(parallel=True, fastmath=True, cache=True, nogil=True)
def vm_gradient(points, planes, lines, out):
    size = planes.shape[1]
    channels = planes.shape[4]
    for n in numba.prange(points.shape[0]):
        out[n, 0] = 0.0
        out[n, 1] = 0.0
        out[n, 2] = 0.0
        for k in range(3):
            i, u = cell(points[n, _axis_a[k]], size)
            j, v = cell(points[n, _axis_b[k]], size)
            m, w = cell(points[n, _axis_c[k]], size)
            w00 = (1 - u) * (1 - v)
            w01 = (1 - u) * v
            w10 = u * (1 - v)
            w11 = u * v
            along_a = np.float32(0.0)
            along_b = np.float32(0.0)
            along_c = np.float32(0.0)
            p00 = planes[k, i, j]
            p01 = planes[k, i, j + 1]
            p10 = planes[k, i + 1, j]
            p11 = planes[k, i + 1, j + 1]
            l0 = lines[k, m]
            l1 = lines[k, m + 1]
            for ch in range(channels):
                value = w00 * p00[0, ch] + w01 * p01[0, ch] + w10 * p10[0, ch] + w11 * p11[0, ch]
                da = w00 * p00[1, ch] + w01 * p01[1, ch] + w10 * p10[1, ch] + w11 * p11[1, ch]
                db = w00 * p00[2, ch] + w01 * p01[2, ch] + w10 * p10[2, ch] + w11 * p11[2, ch]
                line = (1 - w) * l0[0, ch] + w * l1[0, ch]
                dc = (1 - w) * l0[1, ch] + w * l1[1, ch]
                along_a += da * line
                along_b += db * line
                along_c += value * dc
            out[n, _axis_a[k]] += along_a
            out[n, _axis_b[k]] += along_b
            out[n, _axis_c[k]] += along_c


@numba.njit(parallel=True, fastmath=True, cache=True, nogil=True)
def vm_gradient_backward(points, planes, lines, cotangent, grad_planes, grad_lines):
    size = planes.shape[1]
    channels = planes.shape[4]
    tasks_per_pair = (channels + CHANNELS_PER_TASK - 1) // CHANNELS_PER_TASK
    for task in numba.prange(3 * tasks_per_pair):
        k = task // tasks_per_pair
        first = (task % tasks_per_pair) * CHANNELS_PER_TASK
        last = min(first + CHANNELS_PER_TASK, channels)
        for n in range(points.shape[0]):
            i, u = cell(points[n, _axis_a[k]], size)
            j, v = cell(points[n, _axis_b[k]], size)
            m, w = cell(points[n, _axis_c[k]], size)
            ga = cotangent[n, _axis_a[k]]
            gb = cotangent[n, _axis_b[k]]
            gc = cotangent[n, _axis_c[k]]
            p00 = planes[k, i, j]
            p01 = planes[k, i, j + 1]
            p10 = planes[k, i + 1, j]
            p11 = planes[k, i + 1, j + 1]
            q00 = grad_planes[k, i, j]
            q01 = grad_planes[k, i, j + 1]
            q10 = grad_planes[k, i + 1, j]
            q11 = grad_planes[k, i + 1, j + 1]
            l0 = lines[k, m]
            l1 = lines[k, m + 1]
            m0 = grad_lines[k, m]
            m1 = grad_lines[k, m + 1]
            w00 = (1 - u) * (1 - v)
            w01 = (1 - u) * v
            w10 = u * (1 - v)
            w11 = u * v
            for ch in range(first, last):
                value = w00 * p00[0, ch] + w01 * p01[0, ch] + w10 * p10[0, ch] + w11 * p11[0, ch]
                da = w00 * p00[1, ch] + w01 * p01[1, ch] + w10 * p10[1, ch] + w11 * p11[1, ch]
                db = w00 * p00[2, ch] + w01 * p01[2, ch] + w10 * p10[2, ch] + w11 * p11[2, ch]
                line = (1 - w) * l0[0, ch] + w * l1[0, ch]
                dc = (1 - w) * l0[1, ch] + w * l1[1, ch]
                to_value = gc * dc
                to_a = ga * line
                to_b = gb * line
                to_line = ga * da + gb * db
                to_dc = gc * value
                q00[0, ch] += w00 * to_value
                q01[0, ch] += w01 * to_value
                q10[0, ch] += w10 * to_value
                q11[0, ch] += w11 * to_value
                q00[1, ch] += w00 * to_a
                q01[1, ch] += w01 * to_a
                q10[1, ch] += w10 * to_a
                q11[1, ch] += w11 * to_a
                q00[2, ch] += w00 * to_b
                q01[2, ch] += w01 * to_b
                q10[2, ch] += w10 * to_b
                q11[2, ch] += w11 * to_b
                m0[0, ch] += (1 - w) * to_line
                m1[0, ch] += w * to_line
                m0[1, ch] += (1 - w) * to_dc
                m1[1, ch] += w * to_dc
