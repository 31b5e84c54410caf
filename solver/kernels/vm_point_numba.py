"""A VM lookup at one point, and its adjoint: what the kernels of `vm_numba` do for every point."""

from __future__ import annotations

import numpy as np

from .compiling import inlined
from .lanes import add_to, added, blend, load, multiplied, scaled

ONE = np.float32(1)  # an integer one would make its line double precision, at half the speed


@inlined
def cell(x, size):
    """Lower node and fraction of a linear interpolation on `size` nodes, clamped to the grid."""
    x = min(max(x, np.float32(0.0)), np.float32(size - 1))
    lower = min(int(x), size - 2)
    return lower, np.float32(x - lower)


@inlined
def corner_weights(u, v):
    """Weights of a plane's nodes (0, 0), (0, 1), (1, 0), (1, 1) around fractions u, v."""
    return (ONE - u) * (ONE - v), (ONE - u) * v, u * (ONE - v), u * v


@inlined
def plane_and_line(planes, lines, k, i, j, m, weights, w, ch):
    """Both factors of the product of pair k, channel ch, interpolated."""
    plane = (
        weights[0] * planes[k, i, j, ch]
        + weights[1] * planes[k, i, j + 1, ch]
        + weights[2] * planes[k, i + 1, j, ch]
        + weights[3] * planes[k, i + 1, j + 1, ch]
    )
    return plane, (ONE - w) * lines[k, m, ch] + w * lines[k, m + 1, ch]


@inlined
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
        weights = corner_weights(u, v)
        for ch in range(channels):
            plane, line = plane_and_line(planes, lines, k, i, j, m, weights, w, ch)
            total += plane * line
    return total


@inlined
def spread(planes, lines, grad_planes, grad_lines, k, i, j, m, u, v, w, ch, g):
    """Add the adjoint of one product of pair k, channel ch, with cotangent g."""
    w00, w01, w10, w11 = weights = corner_weights(u, v)
    plane, line = plane_and_line(planes, lines, k, i, j, m, weights, w, ch)
    to_plane = g * line
    to_line = g * plane
    grad_planes[k, i, j, ch] += w00 * to_plane
    grad_planes[k, i, j + 1, ch] += w01 * to_plane
    grad_planes[k, i + 1, j, ch] += w10 * to_plane
    grad_planes[k, i + 1, j + 1, ch] += w11 * to_plane
    grad_lines[k, m, ch] += (ONE - w) * to_line
    grad_lines[k, m + 1, ch] += w * to_line


@inlined
def spread_lanes(planes, lines, grad_planes, grad_lines, k, i, j, m, u, v, w, ch, g):
    """`spread` for eight channels from ch on, with their cotangents g."""
    w00, w01, w10, w11 = corner_weights(u, v)
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


@inlined
def difference_cell(x, size):
    """`cell` with the nodes before and after it, clamped to the grid."""
    lower, fraction = cell(x, size)
    return max(lower - 1, 0), lower, min(lower + 2, size - 1), fraction


@inlined
def neighbourhood(planes, lines, k, i0, i, i3, j0, j, j3, m0, m, m3):
    """Channels of the twelve plane nodes and the four line nodes that differences look at."""
    return (
        planes[k, i, j], planes[k, i, j + 1], planes[k, i + 1, j], planes[k, i + 1, j + 1],
        planes[k, i0, j], planes[k, i0, j + 1], planes[k, i3, j], planes[k, i3, j + 1],
        planes[k, i, j0], planes[k, i + 1, j0], planes[k, i, j3], planes[k, i + 1, j3],
        lines[k, m], lines[k, m + 1], lines[k, m0], lines[k, m3],
    )  # fmt: skip


@inlined
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
