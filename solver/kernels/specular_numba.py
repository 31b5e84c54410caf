"""Fused CPU kernels for glossy reflection: sample, weigh, look up the light, add up; and the adjoint.

`render.reflection` has the plain twin (`scatter` and a lookup). A sample's rays are sampled from its
visible GGX normals, dimmed by the occupancy grid, and read means of the environment. Adjoints are
derived by hand, step by step backwards; names g_x are cotangents of x.
"""

import math

import numba
import numpy as np

from .compiling import function, inlined, kernel
from .glossy_rays_numba import ABOVE, ROOM, from_centre, leave, shift_of
from .integral_numba import fetch_rectangle, rectangle
from .lanes import LANES
from .lobe_numba import (
    LEAST_VIEW,
    across,
    frame_adjoint,
    half_vector,
    mirrored,
    power5,
    seen,
    smith,
    smith_slopes,
    stretched_frame,
    to_world,
)
from .vectors_numba import cross, dot, plus, row, times
from .walk_numba import walk

BLOCK = 128  # samples of a task
AT_ONCE, FEW = 16, 6  # rays that the adjoint does at once; samples of fewer go one by one
AT_A_POLE = 2e-7  # squared sine of a polar angle below which the map's row has no slope
AHEAD = np.uint64(4)  # rays between asking for what one reads of the light and reading it


@function
def bring_back(begin, end, weights, passing, table, rows, centre, size, light, slope):
    """What rays begin ≤ k < end see of the map, as far as they get there."""
    last = np.uint64(max(end - 1, 0))
    for k in range(np.uint64(begin), np.uint64(end)):
        ahead = min(k + AHEAD, last)
        fetch_rectangle(
            table, float(centre[ahead, 0]), float(centre[ahead, 1]), float(size[ahead, 0]),
            float(size[ahead, 1]),
        )  # fmt: skip
        through = passing[k] if weights[k, 0] > 0.0 else np.float32(0.0)
        rectangle(
            table, rows, float(centre[k, 0]), float(centre[k, 1]), float(size[k, 0]),
            float(size[k, 1]), float(through), light, slope, k,
        )  # fmt: skip


@inlined
def turn_into(axes, vectors):
    """Vectors [N, 3] along axes [3, 3], in place; where there are none [0, 3], they stay."""
    if axes.shape[0] == 0:
        return
    for k in range(vectors.shape[0]):
        v = row(vectors, k)
        for axis in range(3):
            vectors[k, axis] = dot(row(axes, axis), v)


@inlined
def add_up(s, first, weights, light, radiance):
    r0, r1, r2 = 0.0, 0.0, 0.0
    for k in range(first[s], first[s + 1]):
        r0 += weights[k, 0] * light[k, 0]
        r1 += weights[k, 1] * light[k, 1]
        r2 += weights[k, 2] * light[k, 2]
    radiance[s, 0], radiance[s, 1], radiance[s, 2] = r0, r1, r2


@kernel
def specular(
    normals, views, alphas, f0s, first, shares, u, masking, averaged, widening, spread, shifts, up,
    points, together, reach, box_low, box_axes, box_scale, cell, blocking, table, rows,
    radiance, directions, weights, passing, light, slope, centre, size, growth,
):  # fmt: skip
    """Reflected radiance [S, 3] of samples; what rays [K] carried, for the adjoint and for tracing.

    Rays of sample s are first[s]:first[s + 1], each counting `shares[s]`. `box_low`, `box_axes`,
    `box_scale`: world to box units; `box_axes` is empty where the box has the world's. `shifts` [S, 3]
    and `up` are those of a floor; without one, `shifts` is empty. `weights` [K, 3] are BRDF · cosine /
    density · share; `light` and `slope` are dimmed by `passing`
    already. `growth` [K, 2]: of `size` by ln α.
    """
    samples, nobody = normals.shape[0], np.empty(0, np.float32)
    height, width = table.shape[0] - 1, table.shape[1] - 1
    for block in numba.prange((samples + BLOCK - 1) // BLOCK):
        low, high = block * BLOCK, min((block + 1) * BLOCK, samples)
        begin, end = first[low], first[high]
        origins = np.empty((high - low, 3), np.float32)
        owners = np.empty(end - begin, np.int64)
        found = np.empty((ROOM, LANES), np.float32)
        for s in range(low, high):
            for axis in range(3):
                lifted = points[s, axis] + reach * normals[s, axis]
                origins[s - low, axis] = (lifted - box_low[axis]) * box_scale
            for k in range(np.uint64(first[s] - begin), np.uint64(first[s + 1] - begin)):
                owners[k] = s - low
        turn_into(box_axes, origins)
        for k in range(np.uint64(begin), np.uint64(end), np.uint64(LANES)):
            leave(
                k, np.uint64(end), low, owners, begin, normals, views, alphas, f0s, together, shares, u,
                masking, averaged, widening, spread, shifts, up, width, height, reach, found,
                directions, weights, passing, centre, size, growth,
            )  # fmt: skip
        along = directions[begin:end]
        if box_axes.shape[0] > 0:
            along = along.copy()
            turn_into(box_axes, along)
        walk(
            origins, owners, along, np.float32(box_scale), passing[begin:end], np.float32(cell), blocking,
            passing[begin:end], nobody,
        )  # fmt: skip
        bring_back(begin, end, weights, passing, table, rows, centre, size, light, slope)
        for s in range(low, high):
            add_up(s, first, weights, light, radiance)


@function
def specular_backward_of_sample(
    s, normals, views, alphas, f0s, first, shares, u, masking, shifts, up, directions, light, slope,
    growth, width, height, cotangent, g_directions, g_weights, g_normals, g_alphas, g_f0s,
):  # fmt: skip
    """One sample of `specular_backward`.

    Its rays go through one loop without branches, AT_ONCE at a time: the compiler makes that of loops which
    nothing leaves, not even a division by zero. In the last turn, those that a sample does not have count
    for nothing.
    """
    alpha = float(alphas[s])
    n, v = row(normals, s), row(views, s)
    t, b, view, view_length = seen(n, v)
    st, t1, t2, st_length, square, inverse = stretched_frame(view, alpha)
    view_lambda = smith(view[2], alpha)
    floor_shift = shift_of(shifts, s)
    zero = (0.0, 0.0, 0.0)
    g_t, g_b, g_n, g_view, g_t1, g_t2, g_st = zero, zero, zero, zero, zero, zero, zero
    g_f0, g_alpha, g_view_lambda = zero, 0.0, 0.0
    f0, cotangents = row(f0s, s), row(cotangent, s)
    begin, count = np.uint64(first[s]), first[s + 1] - first[s]
    last = begin + np.uint64(max(count - 1, 0))
    lanes = (count + AT_ONCE - 1) // AT_ONCE * AT_ONCE if count >= FEW else count
    for lane in range(lanes):
        k = min(begin + np.uint64(lane), last)
        half, length, flat, p1, p2, p3, by_share = half_vector(
            st, t1, t2, alpha, float(u[k, 0]), float(u[k, 1])
        )
        view_half, out = mirrored(view, half)
        counts = 1.0 if lane < count and out[2] > ABOVE else 0.0
        bend = shares[s]
        out_lambda = 0.0
        if masking:
            out_lambda = smith(out[2], alpha)
            bend *= (1.0 + view_lambda) / (1.0 + view_lambda + out_lambda)
        m = min(max(1.0 - view_half, 0.0), 1.0)
        m5 = power5(m)
        fresnel = (f0[0] + (1.0 - f0[0]) * m5, f0[1] + (1.0 - f0[1]) * m5, f0[2] + (1.0 - f0[2]) * m5)
        g = times(counts, cotangents)
        lit = (g[0] * fresnel[0], g[1] * fresnel[1], g[2] * fresnel[2])
        g_column = bend * dot(lit, (slope[k, 0, 0], slope[k, 1, 0], slope[k, 2, 0]))
        g_row = bend * dot(lit, (slope[k, 0, 1], slope[k, 1, 1], slope[k, 2, 1]))
        g_columns = dot(lit, (slope[k, 0, 2], slope[k, 1, 2], slope[k, 2, 2]))
        g_lines = dot(lit, (slope[k, 0, 3], slope[k, 1, 3], slope[k, 2, 3]))
        g_alpha += bend * (g_columns * growth[k, 0] + g_lines * growth[k, 1]) / alpha
        g_weight = (
            g[0] * light[k, 0] + counts * g_weights[k, 0],
            g[1] * light[k, 1] + counts * g_weights[k, 1],
            g[2] * light[k, 2] + counts * g_weights[k, 2],
        )
        g_bend = dot(g_weight, fresnel)
        g_m5 = bend * (
            g_weight[0] * (1.0 - f0[0]) + g_weight[1] * (1.0 - f0[1]) + g_weight[2] * (1.0 - f0[2])
        )
        g_f0 = plus(g_f0, bend * (1.0 - m5), g_weight)
        g_out_z = 0.0
        if masking:
            total = 1.0 + view_lambda + out_lambda
            g_ratio = g_bend * shares[s]
            g_view_lambda += g_ratio * out_lambda / (total * total)
            g_out_lambda = -g_ratio * (1.0 + view_lambda) / (total * total)
            by_cosine, by_alpha = smith_slopes(out[2], alpha)
            g_out_z += g_out_lambda * by_cosine
            g_alpha += g_out_lambda * by_alpha
        d = row(directions, k)
        e, e_length, shift = from_centre(d, floor_shift, up)
        square_xy = max(e[0] * e[0] + e[1] * e[1], 1e-14)
        turn = g_column * width / (2.0 * math.pi * square_xy)
        fall = -g_row * height / (math.pi * math.sqrt(square_xy)) if square_xy > AT_A_POLE else 0.0
        g_d = across((turn * e[1], -turn * e[0], fall), e, e_length)
        g_d = plus(g_d, -dot(g_d, shift), up)
        _, d_length = to_world(t, b, n, out)
        g_d = plus(g_d, counts, row(g_directions, k))
        g_d = across(g_d, d, d_length)
        g_t, g_b, g_n = plus(g_t, out[0], g_d), plus(g_b, out[1], g_d), plus(g_n, out[2], g_d)
        g_out = (dot(t, g_d), dot(b, g_d), dot(n, g_d) + g_out_z)
        g_view_half = 2.0 * dot(half, g_out) - 5.0 * m * m * m * m * g_m5
        g_half = plus(times(2.0 * view_half, g_out), g_view_half, view)
        g_view = plus(plus(g_view, -1.0, g_out), g_view_half, half)
        g_long = across(g_half, half, length)
        g_alpha += g_long[0] * flat[0] + g_long[1] * flat[1]
        g_flat = (alpha * g_long[0], alpha * g_long[1], g_long[2] if flat[2] > 1e-7 else 0.0)
        g_p2 = dot(g_flat, t2)
        g_p2 -= dot(g_flat, st) * p2 / p3 if 1.0 - p1 * p1 - p2 * p2 > 1e-12 else 0.0
        g_t1, g_t2, g_st = plus(g_t1, p1, g_flat), plus(g_t2, p2, g_flat), plus(g_st, p3, g_flat)
        g_st = (g_st[0], g_st[1], g_st[2] + 0.5 * g_p2 * by_share)
    if masking:
        by_cosine, by_alpha = smith_slopes(view[2], alpha)
        g_view = (g_view[0], g_view[1], g_view[2] + g_view_lambda * by_cosine)
        g_alpha += g_view_lambda * by_alpha
    g_st = plus(g_st, 1.0, cross(t1, g_t2))
    g_t1 = plus(g_t1, 1.0, cross(g_t2, st))
    if square > 1e-12:
        g_square = -0.5 * inverse * inverse * inverse * (st[0] * g_t1[1] - st[1] * g_t1[0])
        g_st = (
            g_st[0] + inverse * g_t1[1] + 2.0 * st[0] * g_square,
            g_st[1] - inverse * g_t1[0] + 2.0 * st[1] * g_square,
            g_st[2],
        )
    g_raw = across(g_st, st, st_length)
    g_alpha += g_raw[0] * view[0] + g_raw[1] * view[1]
    g_view = (g_view[0] + alpha * g_raw[0], g_view[1] + alpha * g_raw[1], g_view[2] + g_raw[2])
    g_seen = across(g_view, view, view_length)
    g_t, g_b = plus(g_t, g_seen[0], v), plus(g_b, g_seen[1], v)
    if dot(n, v) > LEAST_VIEW:
        g_n = plus(g_n, g_seen[2], v)
    g_n = plus(g_n, 1.0, frame_adjoint(n, g_t, g_b))
    g_alphas[s] = g_alpha
    for c in range(3):
        g_normals[s, c] = g_n[c]
        g_f0s[s, c] = g_f0[c]


@kernel
def specular_backward(
    normals, views, alphas, f0s, first, shares, u, masking, shifts, up, directions, weights, passing,
    light, slope, growth, width, height, cotangent, g_directions, g_weights, g_normals, g_alphas, g_f0s,
    to_light,
):  # fmt: skip
    """Adjoint of `specular` with respect to normals, α and F0: of radiances (`cotangent`), and of the
    rays' directions and weights; and the cotangents [K, 3] of undimmed mean radiances along rays."""
    for s in numba.prange(normals.shape[0]):
        specular_backward_of_sample(
            s, normals, views, alphas, f0s, first, shares, u, masking, shifts, up, directions, light,
            slope, growth, width, height, cotangent, g_directions, g_weights, g_normals, g_alphas, g_f0s,
        )  # fmt: skip
        for k in range(first[s], first[s + 1]):
            for c in range(3):
                to_light[k, c] = cotangent[s, c] * weights[k, c] * np.float32(passing[k])
