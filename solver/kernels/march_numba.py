"""Fused CPU kernels that walk rays through the field; `march_torch` is their plain twin.

Positions are in box units: the region of interest is [0, 1]^3 (`field.box`), so the directions are
not unit vectors there; `t` stays in world units because origin and direction scale together.
"""

import math

import numba
import numpy as np

from .compiling import inlined, kernel
from .vm_point_numba import ONE, raw_density
from .walk_numba import box_span, walk

BLOCK = 256  # rays of a task


@inlined
def extinction(raw, shift, scale):
    """σ = scale · softplus(raw + shift), per world unit; single precision, to end walks by."""
    x = raw + np.float32(shift)
    return scale * (x if x > np.float32(20.0) else math.log(ONE + math.exp(x)))


@kernel
def march(
    origins, directions, start, jitter, step, cell, free, planes, lines, shift, scale,
    min_transmittance, distance, raw, counts,
):  # fmt: skip
    """Distances and raw densities [R, capacity] of every ray's samples in occupied space.

    Samples lie at t = entry + (i + jitter)·step. Those where `free` is not 0 are left out; the walk ends
    below `min_transmittance`.
    """
    cells = free.shape[0]
    step_cells = step / cell
    nodes = planes.shape[1] - 1
    capacity = distance.shape[1]
    # Optical depths add up: no exponential a sample.
    most = -math.log(max(min_transmittance, 1e-30))
    for r in numba.prange(origins.shape[0]):
        ox, oy, oz = origins[r, 0], origins[r, 1], origins[r, 2]
        dx, dy, dz = directions[r, 0], directions[r, 1], directions[r, 2]
        near, far = box_span(ox, oy, oz, dx, dy, dz)
        near = max(near, start[r])
        count = 0
        depth = 0.0
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
            distance[r, count] = t
            raw[r, count] = density
            count += 1
            depth += extinction(density, shift, scale) * step
            if depth > most:
                break
            t += step
        counts[r] = count


@numba.njit(parallel=True, cache=True, nogil=True)
def compact(origins, directions, distance, raw, offsets, flat_distance, flat_raw, points, ray):
    """Copy the rows' leading entries into flat segments, and note where they are."""
    for r in numba.prange(origins.shape[0]):
        first = offsets[r]
        for i in range(offsets[r + 1] - first):
            t = distance[r, i]
            flat_distance[first + i] = t
            flat_raw[first + i] = raw[r, i]
            for axis in range(3):
                points[first + i, axis] = origins[r, axis] + t * directions[r, axis]
            ray[first + i] = r


@kernel
def grid_transmittance(origins, directions, start, step, blocking, out):
    """Transmittance [R] of rays through a grid of extinctions, nearest cell, until nearly opaque."""
    rays, nobody = origins.shape[0], np.empty(0, np.float32)
    for block in numba.prange((rays + BLOCK - 1) // BLOCK):
        low, high = block * BLOCK, min((block + 1) * BLOCK, rays)
        walk(
            origins[low:high], np.arange(high - low), directions[low:high], np.float32(1.0),
            start[low:high], step, blocking, out[low:high], nobody,
        )  # fmt: skip


@kernel
def composite(optical_depth, offsets, weights, transmittance):
    """Weights T_i (1 − exp(−τ_i)) of flat segments and the transmittance left behind each ray."""
    for r in numba.prange(offsets.shape[0] - 1):
        passing = np.float32(1.0)
        for i in range(offsets[r], offsets[r + 1]):
            keep = np.float32(math.exp(-optical_depth[i]))
            weights[i] = passing * (np.float32(1.0) - keep)
            passing *= keep
        transmittance[r] = passing


@kernel
def composite_backward(offsets, weights, transmittance, g_weights, g_transmittance, out):
    """Adjoint of `composite`: dw_i/dτ_i = T_{i+1}, dw_j/dτ_i = −w_j for j > i, dT/dτ_i = −T."""
    for r in numba.prange(offsets.shape[0] - 1):
        behind = g_transmittance[r] * transmittance[r]
        passing = transmittance[r]
        for i in range(offsets[r + 1] - 1, offsets[r] - 1, -1):
            out[i] = g_weights[i] * passing - behind
            behind += g_weights[i] * weights[i]
            passing += weights[i]
