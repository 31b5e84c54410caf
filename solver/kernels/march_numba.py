"""Fused CPU kernels that walk rays through the field; `march_torch` is their plain twin.

Positions are in box units: the region of interest is [0, 1]^3 (`field.box`), so the directions are
not unit vectors there; `t` stays in world units because origin and direction scale together.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from .skipping import DEPTHS_PER_UNIT, EMPTY
from .vm_point_numba import raw_density

DEPTH_UNIT = np.float32(1 / DEPTHS_PER_UNIT)
LEAST_OPAQUE = np.float32(7.0)
"""optical depth from which nothing passes"""
HALF = np.float32(math.log(2))
"""optical depth that half of the light passes"""


@numba.njit(inline="always")
def box_span(ox, oy, oz, dx, dy, dz):
    """Entry and exit distance of a ray through [0, 1]^3 (slab test); entry > exit if it misses."""
    near = np.float32(-1e30)
    far = np.float32(1e30)
    for axis in range(3):
        o = ox if axis == 0 else (oy if axis == 1 else oz)
        d = dx if axis == 0 else (dy if axis == 1 else dz)
        if abs(d) < 1e-12:
            if o < 0.0 or o > 1.0:
                return np.float32(1.0), np.float32(0.0)
        else:
            t0 = (np.float32(0.0) - o) / d
            t1 = (np.float32(1.0) - o) / d
            near = max(near, min(t0, t1))
            far = min(far, max(t0, t1))
    return near, far


@numba.njit(inline="always", fastmath=True)
def extinction(raw, shift, scale):
    """σ = scale · softplus(raw + shift), per world unit."""
    x = raw + shift
    return scale * (x if x > 20.0 else math.log1p(math.exp(x)))


@numba.njit(parallel=True, fastmath=True, cache=True, nogil=True)
def march(
    origins, directions, start, jitter, step, cell, free, planes, lines, shift, scale,
    min_transmittance, min_alpha, distance, raw, counts,
):  # fmt: skip
    """Distances and raw densities [R, capacity] of every ray's samples in occupied space.

    Samples lie at t = entry + (i + jitter)·step. Those where `free` is not 0, and ones more
    transparent than `min_alpha`, are left out; the walk ends below `min_transmittance`.
    """
    cells = free.shape[0]
    step_cells = step / cell
    nodes = planes.shape[1] - 1
    capacity = distance.shape[1]
    for r in numba.prange(origins.shape[0]):
        ox, oy, oz = origins[r, 0], origins[r, 1], origins[r, 2]
        dx, dy, dz = directions[r, 0], directions[r, 1], directions[r, 2]
        near, far = box_span(ox, oy, oz, dx, dy, dz)
        near = max(near, start[r])
        count = 0
        transmittance = 1.0
        t = near + jitter[r] * step
        while t < far and count < capacity:
            x, y, z = ox + t * dx, oy + t * dy, oz + t * dz
            i = min(max(int(x * cells), 0), cells - 1)
            j = min(max(int(y * cells), 0), cells - 1)
            k = min(max(int(z * cells), 0), cells - 1)
            ahead = free[i, j, k]
            if ahead:
                t += step * (int((ahead - 1) / step_cells) + 1)
                continue
            density = raw_density(x * nodes, y * nodes, z * nodes, planes, lines)
            keep = math.exp(-extinction(density, shift, scale) * step)
            if 1.0 - keep >= min_alpha:
                distance[r, count] = t
                raw[r, count] = density
                count += 1
                transmittance *= keep
                if transmittance < min_transmittance:
                    break
            t += step
        counts[r] = count


@numba.njit(parallel=True, cache=True, nogil=True)
def compact(
    origins, directions, distance, raw, counts, offsets, flat_distance, flat_raw, points, ray
):  # fmt: skip
    """Copy the rows' leading entries into flat segments, and note where they are."""
    for r in numba.prange(counts.shape[0]):
        first = offsets[r]
        for i in range(counts[r]):
            t = distance[r, i]
            flat_distance[first + i] = t
            flat_raw[first + i] = raw[r, i]
            for axis in range(3):
                points[first + i, axis] = origins[r, axis] + t * directions[r, axis]
            ray[first + i] = r


@numba.njit(inline="always", fastmath=True)
def through_grid(ox, oy, oz, dx, dy, dz, start, step, blocking):
    """Transmittance of one ray through a grid made by `skipping.blocking_grid`, a cell a step, and the
    distance at which half of its light is stopped, or infinity."""
    cells = blocking.shape[0]
    near, far = box_span(ox, oy, oz, dx, dy, dz)
    t = max(near, start)
    depth, half = np.float32(0.0), np.float32(math.inf)
    while t < far and depth < LEAST_OPAQUE:
        i = min(max(int((ox + t * dx) * cells), 0), cells - 1)
        j = min(max(int((oy + t * dy) * cells), 0), cells - 1)
        k = min(max(int((oz + t * dz) * cells), 0), cells - 1)
        code = blocking[i, j, k]
        if code < EMPTY:
            before = depth
            depth += DEPTH_UNIT * np.float32(code)
            if before <= HALF and depth > HALF:
                half = t
            t += step
        else:
            t += step * (code - EMPTY)
    return math.exp(-depth), half


@numba.njit(inline="always", fastmath=True)
def through_four(origin, directions, scale, first, last, step, blocking, passing):
    """`through_grid` of rays first:last of at most four, side by side; directions are world · `scale`.

    A ray's next read waits for its last one, so a single one leaves the processor idle.

    Args:
        passing: in, distances from which rays can be blocked; out, transmittances.
    """
    k1, k2, k3 = min(first + 1, last - 1), min(first + 2, last - 1), min(first + 3, last - 1)
    ray0 = entered(origin, directions, scale, first, passing)
    ray1 = entered(origin, directions, scale, k1, passing)
    ray2 = entered(origin, directions, scale, k2, passing)
    ray3 = entered(origin, directions, scale, k3, passing)
    t0, t1, t2, t3 = ray0[0], ray1[0], ray2[0], ray3[0]
    depth0 = depth1 = depth2 = depth3 = np.float32(0.0)
    while t0 < ray0[1] or t1 < ray1[1] or t2 < ray2[1] or t3 < ray3[1]:
        t0, depth0 = stride(origin, ray0, t0, depth0, step, blocking)
        t1, depth1 = stride(origin, ray1, t1, depth1, step, blocking)
        t2, depth2 = stride(origin, ray2, t2, depth2, step, blocking)
        t3, depth3 = stride(origin, ray3, t3, depth3, step, blocking)
    passing[first], passing[k1] = math.exp(-depth0), math.exp(-depth1)
    passing[k2], passing[k3] = math.exp(-depth2), math.exp(-depth3)


@numba.njit(inline="always", fastmath=True)
def entered(origin, directions, scale, k, start):
    """Where ray k begins and ends in the box, and its direction in box units."""
    dx, dy, dz = directions[k, 0] * scale, directions[k, 1] * scale, directions[k, 2] * scale
    near, far = box_span(origin[0], origin[1], origin[2], dx, dy, dz)
    return max(near, start[k]), far, dx, dy, dz


@numba.njit(inline="always", fastmath=True)
def stride(origin, ray, t, depth, step, blocking):
    """Distance and optical depth of a ray one read further; it ends where it is opaque."""
    _, far, dx, dy, dz = ray
    cells = blocking.shape[0]
    i = min(max(int((origin[0] + t * dx) * cells), 0), cells - 1)
    j = min(max(int((origin[1] + t * dy) * cells), 0), cells - 1)
    k = min(max(int((origin[2] + t * dz) * cells), 0), cells - 1)
    code = blocking[i, j, k]
    if t >= far:
        return t, depth
    if code >= EMPTY:
        return t + step * np.float32(code - EMPTY), depth
    depth += DEPTH_UNIT * np.float32(code)
    return (t + step if depth < LEAST_OPAQUE else far), depth


@numba.njit(parallel=True, fastmath=True, cache=True, nogil=True)
def grid_transmittance(origins, directions, start, step, blocking, out):
    """Transmittance [R] of rays through a grid of extinctions, nearest cell, until nearly opaque."""
    for r in numba.prange(origins.shape[0]):
        out[r] = through_grid(
            origins[r, 0], origins[r, 1], origins[r, 2],
            directions[r, 0], directions[r, 1], directions[r, 2], start[r], step, blocking,
        )[0]  # fmt: skip


@numba.njit(parallel=True, fastmath=True, cache=True, nogil=True)
def composite(optical_depth, offsets, weights, transmittance):
    """Weights T_i (1 − exp(−τ_i)) of flat segments and the transmittance left behind each ray."""
    for r in numba.prange(offsets.shape[0] - 1):
        passing = np.float32(1.0)
        for i in range(offsets[r], offsets[r + 1]):
            keep = np.float32(math.exp(-optical_depth[i]))
            weights[i] = passing * (np.float32(1.0) - keep)
            passing *= keep
        transmittance[r] = passing


@numba.njit(parallel=True, fastmath=True, cache=True, nogil=True)
def composite_backward(offsets, weights, transmittance, g_weights, g_transmittance, out):
    """Adjoint of `composite`: dw_i/dτ_i = T_{i+1}, dw_j/dτ_i = −w_j for j > i, dT/dτ_i = −T."""
    for r in numba.prange(offsets.shape[0] - 1):
        behind = g_transmittance[r] * transmittance[r]
        passing = transmittance[r]
        for i in range(offsets[r + 1] - 1, offsets[r] - 1, -1):
            out[i] = g_weights[i] * passing - behind
            behind += g_weights[i] * weights[i]
            passing += weights[i]
