"""A VM lookup at one point, and its adjoint: what the kernels of `vm_numba` do for every point.

What works on channels does so for one, or for eight at once (`lanes`): for as many as `like` has, or a
cotangent.
"""

import numpy as np

from .compiling import inlined
from .lanes import LANES, add_to, eight_of, load, total

ZERO = np.float32(0)
ONE = np.float32(1)  # an integer one would make its line double precision, at half the speed
HALF = np.float32(0.5)
AXIS_A, AXIS_B, AXIS_C = np.array([0, 0, 1]), np.array([1, 2, 2]), np.array([2, 1, 0])
"""of the points: along the first and second axis of each pair's plane, and along its line"""


@inlined
def cell(x, size):
    """Lower node and fraction of a linear interpolation on `size` nodes, clamped to the grid."""
    x = min(max(x, np.float32(0.0)), np.float32(size - 1))
    lower = min(int(x), size - 2)
    return lower, np.float32(x - lower)


@inlined
def cells_of(points, n, k, size):
    """Cells of pair k around a point: lower nodes of its plane and its line, and the fractions."""
    i, u = cell(points[n, AXIS_A[k]], size)
    j, v = cell(points[n, AXIS_B[k]], size)
    m, w = cell(points[n, AXIS_C[k]], size)
    return i, j, m, u, v, w


@inlined
def corner_weights(u, v):
    """Weights of a plane's nodes (0, 0), (0, 1), (1, 0), (1, 1) around fractions u, v."""
    return (ONE - u) * (ONE - v), (ONE - u) * v, u * (ONE - v), u * v


@inlined
def plane_and_line(planes, lines, k, i, j, m, weights, w, ch, like):
    """Both factors of the product of pair k from channel ch on, interpolated."""
    plane = (
        weights[0] * load(planes, (k, i, j, ch), like)
        + weights[1] * load(planes, (k, i, j + 1, ch), like)
        + weights[2] * load(planes, (k, i + 1, j, ch), like)
        + weights[3] * load(planes, (k, i + 1, j + 1, ch), like)
    )
    line = (ONE - w) * load(lines, (k, m, ch), like) + w * load(lines, (k, m + 1, ch), like)
    return plane, line


@inlined
def with_pair(planes, lines, k, i, j, m, u, v, w, many, one):
    """Sums of products of eight channels and of one, with those of pair k added."""
    channels, weights = planes.shape[3], corner_weights(u, v)
    whole = channels - channels % LANES
    for ch in range(0, whole, LANES):
        plane, line = plane_and_line(planes, lines, k, i, j, m, weights, w, ch, many)
        many = many + plane * line
    for ch in range(whole, channels):
        plane, line = plane_and_line(planes, lines, k, i, j, m, weights, w, ch, one)
        one = one + plane * line
    return many, one


@inlined
def raw_density(px, py, pz, planes, lines):
    """The VM sum at one point in grid units."""
    size = planes.shape[1]
    i, u = cell(px, size)
    j, v = cell(py, size)
    m, w = cell(pz, size)
    many, one = with_pair(planes, lines, 0, i, j, m, u, v, w, eight_of(ZERO), ZERO)
    many, one = with_pair(planes, lines, 1, i, m, j, u, w, v, many, one)
    many, one = with_pair(planes, lines, 2, j, m, i, v, w, u, many, one)
    return total(many) + one


@inlined
def spread(planes, lines, grad_planes, grad_lines, k, i, j, m, weights, w, ch, g):
    """Add the adjoint of the products of pair k from channel ch on, with their cotangents g."""
    plane, line = plane_and_line(planes, lines, k, i, j, m, weights, w, ch, g)
    to_plane, to_line = g * line, g * plane
    add_to(grad_planes, (k, i, j, ch), weights[0] * to_plane)
    add_to(grad_planes, (k, i, j + 1, ch), weights[1] * to_plane)
    add_to(grad_planes, (k, i + 1, j, ch), weights[2] * to_plane)
    add_to(grad_planes, (k, i + 1, j + 1, ch), weights[3] * to_plane)
    add_to(grad_lines, (k, m, ch), (ONE - w) * to_line)
    add_to(grad_lines, (k, m + 1, ch), w * to_line)


@inlined
def difference_cell(x, size):
    """`cell` as its two nodes between those before and after, clamped to the grid; and the fraction."""
    lower, fraction = cell(x, size)
    return max(lower - 1, 0), lower, lower + 1, min(lower + 2, size - 1), fraction


@inlined
def differences(planes, lines, k, a, b, c, ch, like):
    """Plane, its differences along both axes, line and its difference, of pair k from channel ch on.

    The differences are central ones at the nodes, interpolated, and twice as large as they should be.
    a, b, c: see `difference_cell`.
    """
    u, v, w = a[4], b[4], c[4]
    near_u, near_v, near_w = ONE - u, ONE - v, ONE - w
    p00, p01 = load(planes, (k, a[1], b[1], ch), like), load(planes, (k, a[1], b[2], ch), like)
    p10, p11 = load(planes, (k, a[2], b[1], ch), like), load(planes, (k, a[2], b[2], ch), like)
    low_b, high_b = near_u * p00 + u * p10, near_u * p01 + u * p11
    low_a, high_a = near_v * p00 + v * p01, near_v * p10 + v * p11
    before_a = near_v * load(planes, (k, a[0], b[1], ch), like)
    before_a = before_a + v * load(planes, (k, a[0], b[2], ch), like)
    after_a = near_v * load(planes, (k, a[3], b[1], ch), like)
    after_a = after_a + v * load(planes, (k, a[3], b[2], ch), like)
    before_b = near_u * load(planes, (k, a[1], b[0], ch), like)
    before_b = before_b + u * load(planes, (k, a[2], b[0], ch), like)
    after_b = near_u * load(planes, (k, a[1], b[3], ch), like)
    after_b = after_b + u * load(planes, (k, a[2], b[3], ch), like)
    value = near_v * low_b + v * high_b
    by_a = near_u * (high_a - before_a) + u * (after_a - low_a)
    by_b = near_v * (high_b - before_b) + v * (after_b - low_b)
    l0, l1 = load(lines, (k, c[1], ch), like), load(lines, (k, c[2], ch), like)
    line = near_w * l0 + w * l1
    before_c, after_c = load(lines, (k, c[0], ch), like), load(lines, (k, c[3], ch), like)
    by_c = near_w * (l1 - before_c) + w * (after_c - l0)
    return value, by_a, by_b, line, by_c


@inlined
def spread_differences(planes, lines, grad_planes, grad_lines, k, a, b, c, ga, gb, gc, ch, like):
    """Add the adjoint of value · by_c, by_a · line and by_b · line with cotangents gc, ga, gb."""
    value, by_a, by_b, line, by_c = differences(planes, lines, k, a, b, c, ch, like)
    u, v, w = a[4], b[4], c[4]
    near_u, near_v, near_w = ONE - u, ONE - v, ONE - w
    to_value, to_by_c = gc * by_c, gc * value
    to_line = ga * by_a + gb * by_b
    to_a, to_b = ga * line, gb * line
    to_near_a, to_far_a = near_u * to_a, u * to_a
    to_near_b, to_far_b = near_v * to_b, v * to_b
    low, high = near_u * to_value - to_far_a, u * to_value + to_near_a
    add_to(grad_planes, (k, a[1], b[1], ch), near_v * low - near_u * to_far_b)
    add_to(grad_planes, (k, a[1], b[2], ch), v * low + near_u * to_near_b)
    add_to(grad_planes, (k, a[2], b[1], ch), near_v * high - u * to_far_b)
    add_to(grad_planes, (k, a[2], b[2], ch), v * high + u * to_near_b)
    add_to(grad_planes, (k, a[0], b[1], ch), -near_v * to_near_a)
    add_to(grad_planes, (k, a[0], b[2], ch), -v * to_near_a)
    add_to(grad_planes, (k, a[3], b[1], ch), near_v * to_far_a)
    add_to(grad_planes, (k, a[3], b[2], ch), v * to_far_a)
    add_to(grad_planes, (k, a[1], b[0], ch), -near_u * to_near_b)
    add_to(grad_planes, (k, a[2], b[0], ch), -u * to_near_b)
    add_to(grad_planes, (k, a[1], b[3], ch), near_u * to_far_b)
    add_to(grad_planes, (k, a[2], b[3], ch), u * to_far_b)
    add_to(grad_lines, (k, c[1], ch), near_w * to_line - w * to_by_c)
    add_to(grad_lines, (k, c[2], ch), w * to_line + near_w * to_by_c)
    add_to(grad_lines, (k, c[0], ch), -near_w * to_by_c)
    add_to(grad_lines, (k, c[3], ch), w * to_by_c)
