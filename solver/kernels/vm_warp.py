"""VM lookups in Warp, for CUDA; `vm_torch` is their plain twin and describes the layout.

Functions take the arguments of `vm_numba`, as tensors. A thread takes a point, or, where it reads or
writes one number a channel, a point and a channel, so that neighbouring threads meet neighbouring
addresses. Adjoints add atomically: sums may differ in their last bits from run to run.
"""

import torch
import warp as wp

from .vectors_warp import Grid, Numbers, Planes, Vectors, vector
from .vm_point_warp import Cell, axis_a, axis_b, axis_c, cell_of, line_at, plane_at, raw_density
from .warp_device import launch, launched

wp.set_module_options({"enable_backward": False, "fast_math": True})


@wp.struct
class Stencil:
    """A plane and a line around a point in one channel, with their differences (twice too large)."""

    value: float
    along_a: float
    along_b: float
    line: float
    along_c: float


@wp.func
def cells_of(points: Vectors, n: int, k: int, size: int):
    """Of pair k around a point: along both axes of its plane, and along its line."""
    a = cell_of(points[n, axis_a(k)], size)
    b = cell_of(points[n, axis_b(k)], size)
    return a, b, cell_of(points[n, axis_c(k)], size)


@wp.kernel
def _sum(points: Vectors, planes: Planes, lines: Grid, out: Numbers):
    n = wp.tid()
    out[n] = raw_density(vector(points, n), planes, lines)


@wp.kernel
def _products(points: Vectors, planes: Planes, lines: Grid, out: Vectors):
    n, ch = wp.tid()
    size = planes.shape[1]
    for k in range(3):
        a, b, c = cells_of(points, n, k, size)
        product = plane_at(planes, k, a, b, ch) * line_at(lines, k, c, ch)
        out[n, k * planes.shape[3] + ch] = product


@wp.func
def spread(
    planes: Planes, lines: Grid, grad_planes: Planes, grad_lines: Grid, k: int, a: Cell, b: Cell,
    c: Cell, ch: int, g: float,
):  # fmt: skip
    """Add the adjoint of one product of pair k, channel ch, with cotangent g."""
    u = a.fraction
    v = b.fraction
    w = c.fraction
    to_plane = g * line_at(lines, k, c, ch)
    to_line = g * plane_at(planes, k, a, b, ch)
    wp.atomic_add(grad_planes, k, a.lower, b.lower, ch, (1.0 - u) * (1.0 - v) * to_plane)
    wp.atomic_add(grad_planes, k, a.lower, b.lower + 1, ch, (1.0 - u) * v * to_plane)
    wp.atomic_add(grad_planes, k, a.lower + 1, b.lower, ch, u * (1.0 - v) * to_plane)
    wp.atomic_add(grad_planes, k, a.lower + 1, b.lower + 1, ch, u * v * to_plane)
    wp.atomic_add(grad_lines, k, c.lower, ch, (1.0 - w) * to_line)
    wp.atomic_add(grad_lines, k, c.lower + 1, ch, w * to_line)


@wp.kernel
def _sum_backward(
    points: Vectors, planes: Planes, lines: Grid, cotangent: Numbers, least: Numbers,
    grad_planes: Planes, grad_lines: Grid,
):  # fmt: skip
    n, ch = wp.tid()
    g = cotangent[n]
    if wp.abs(g) <= least[0]:
        return
    size = planes.shape[1]
    for k in range(3):
        a, b, c = cells_of(points, n, k, size)
        spread(planes, lines, grad_planes, grad_lines, k, a, b, c, ch, g)


@wp.kernel
def _products_backward(
    points: Vectors, planes: Planes, lines: Grid, cotangent: Vectors, grad_planes: Planes, grad_lines: Grid
):
    n, ch = wp.tid()
    size = planes.shape[1]
    for k in range(3):
        a, b, c = cells_of(points, n, k, size)
        g = cotangent[n, k * planes.shape[3] + ch]
        spread(planes, lines, grad_planes, grad_lines, k, a, b, c, ch, g)


@wp.func
def stencil_at(planes: Planes, lines: Grid, k: int, a: Cell, b: Cell, c: Cell, ch: int):
    u = a.fraction
    v = b.fraction
    w = c.fraction
    i = a.lower
    j = b.lower
    low_b = (1.0 - u) * planes[k, i, j, ch] + u * planes[k, i + 1, j, ch]
    high_b = (1.0 - u) * planes[k, i, j + 1, ch] + u * planes[k, i + 1, j + 1, ch]
    low_a = (1.0 - v) * planes[k, i, j, ch] + v * planes[k, i, j + 1, ch]
    high_a = (1.0 - v) * planes[k, i + 1, j, ch] + v * planes[k, i + 1, j + 1, ch]
    before_a = (1.0 - v) * planes[k, a.before, j, ch] + v * planes[k, a.before, j + 1, ch]
    after_a = (1.0 - v) * planes[k, a.after, j, ch] + v * planes[k, a.after, j + 1, ch]
    before_b = (1.0 - u) * planes[k, i, b.before, ch] + u * planes[k, i + 1, b.before, ch]
    after_b = (1.0 - u) * planes[k, i, b.after, ch] + u * planes[k, i + 1, b.after, ch]
    l0 = lines[k, c.lower, ch]
    l1 = lines[k, c.lower + 1, ch]
    found = Stencil()
    found.value = (1.0 - v) * low_b + v * high_b
    found.along_a = (1.0 - u) * (high_a - before_a) + u * (after_a - low_a)
    found.along_b = (1.0 - v) * (high_b - before_b) + v * (after_b - low_b)
    found.line = (1.0 - w) * l0 + w * l1
    found.along_c = (1.0 - w) * (l1 - lines[k, c.before, ch]) + w * (lines[k, c.after, ch] - l0)
    return found


@wp.kernel
def _gradient(points: Vectors, planes: Planes, lines: Grid, out: Vectors):
    n = wp.tid()
    size = planes.shape[1]
    total = wp.vec3(0.0)
    for k in range(3):
        a, b, c = cells_of(points, n, k, size)
        for ch in range(planes.shape[3]):
            here = stencil_at(planes, lines, k, a, b, c, ch)
            total[axis_a(k)] += 0.5 * here.along_a * here.line
            total[axis_b(k)] += 0.5 * here.along_b * here.line
            total[axis_c(k)] += 0.5 * here.value * here.along_c
    for axis in range(3):
        out[n, axis] = total[axis]


@wp.kernel
def _gradient_backward(
    points: Vectors, planes: Planes, lines: Grid, cotangent: Vectors, grad_planes: Planes, grad_lines: Grid
):
    n, ch = wp.tid()
    size = planes.shape[1]
    for k in range(3):
        a, b, c = cells_of(points, n, k, size)
        here = stencil_at(planes, lines, k, a, b, c, ch)
        to_along_a = 0.5 * cotangent[n, axis_a(k)]
        to_along_b = 0.5 * cotangent[n, axis_b(k)]
        to_along_c = 0.5 * cotangent[n, axis_c(k)]
        u = a.fraction
        v = b.fraction
        w = c.fraction
        i = a.lower
        j = b.lower
        to_value = to_along_c * here.along_c
        to_a = to_along_a * here.line
        to_b = to_along_b * here.line
        low = (1.0 - u) * to_value
        high = u * to_value
        to_p00 = (1.0 - v) * (low - u * to_a) - (1.0 - u) * v * to_b
        to_p01 = v * (low - u * to_a) + (1.0 - u) * (1.0 - v) * to_b
        to_p10 = (1.0 - v) * (high + (1.0 - u) * to_a) - u * v * to_b
        to_p11 = v * (high + (1.0 - u) * to_a) + u * (1.0 - v) * to_b
        wp.atomic_add(grad_planes, k, i, j, ch, to_p00)
        wp.atomic_add(grad_planes, k, i, j + 1, ch, to_p01)
        wp.atomic_add(grad_planes, k, i + 1, j, ch, to_p10)
        wp.atomic_add(grad_planes, k, i + 1, j + 1, ch, to_p11)
        wp.atomic_add(grad_planes, k, a.before, j, ch, -(1.0 - v) * (1.0 - u) * to_a)
        wp.atomic_add(grad_planes, k, a.before, j + 1, ch, -v * (1.0 - u) * to_a)
        wp.atomic_add(grad_planes, k, a.after, j, ch, (1.0 - v) * u * to_a)
        wp.atomic_add(grad_planes, k, a.after, j + 1, ch, v * u * to_a)
        wp.atomic_add(grad_planes, k, i, b.before, ch, -(1.0 - u) * (1.0 - v) * to_b)
        wp.atomic_add(grad_planes, k, i + 1, b.before, ch, -u * (1.0 - v) * to_b)
        wp.atomic_add(grad_planes, k, i, b.after, ch, (1.0 - u) * v * to_b)
        wp.atomic_add(grad_planes, k, i + 1, b.after, ch, u * v * to_b)
        to_line = to_along_a * here.along_a + to_along_b * here.along_b
        to_dc = to_along_c * here.value
        wp.atomic_add(grad_lines, k, c.lower, ch, (1.0 - w) * to_line - w * to_dc)
        wp.atomic_add(grad_lines, k, c.lower + 1, ch, w * to_line + (1.0 - w) * to_dc)
        wp.atomic_add(grad_lines, k, c.before, ch, -(1.0 - w) * to_dc)
        wp.atomic_add(grad_lines, k, c.after, ch, w * to_dc)


@wp.func
def mirrored(i: int, size: int):
    """Row beyond a border of a plane, which is mirrored (b a | a b c)."""
    inside = i % (2 * size)
    if inside < 0:
        inside += 2 * size
    if inside >= size:
        inside = 2 * size - 1 - inside
    return inside


@wp.kernel
def _smooth(planes: Planes, taps: Numbers, along_rows: bool, out: Planes):
    ki, j, ch = wp.tid()
    size = planes.shape[1]
    k = ki // size
    i = ki % size
    reach = taps.shape[0] // 2
    total = float(0.0)
    for tap in range(taps.shape[0]):
        if along_rows:
            total += taps[tap] * planes[k, mirrored(i + tap - reach, size), j, ch]
        else:
            total += taps[tap] * planes[k, i, mirrored(j + tap - reach, size), ch]
    out[k, i, j, ch] = total


vm_sum = launched(_sum, "points")


def vm_sum_backward(points, planes, lines, cotangent, least, grad_planes, grad_lines) -> None:
    dim = len(points), planes.shape[3]
    launch(_sum_backward, dim, points, planes, lines, cotangent, least.view(1), grad_planes, grad_lines)


def vm_products(points, planes, lines, out) -> None:
    launch(_products, (len(points), planes.shape[3]), points, planes, lines, out)


def vm_products_backward(points, planes, lines, cotangent, grad_planes, grad_lines) -> None:
    dim = len(points), planes.shape[3]
    launch(_products_backward, dim, points, planes, lines, cotangent, grad_planes, grad_lines)


vm_gradient = launched(_gradient, "points")


def vm_gradient_backward(points, planes, lines, cotangent, grad_planes, grad_lines) -> None:
    dim = len(points), planes.shape[3]
    launch(_gradient_backward, dim, points, planes, lines, cotangent, grad_planes, grad_lines)


def smooth_planes(planes, taps, out) -> None:
    dim = 3 * planes.shape[1], *planes.shape[2:]
    between = torch.empty_like(planes)
    launch(_smooth, dim, planes, taps, True, between)
    launch(_smooth, dim, between, taps, False, out)


def smooth_lines(lines, taps, out) -> None:
    size, channels = lines.shape[1:]
    one_wide = lines.view(3, size, 1, channels), out.view(3, size, 1, channels)
    launch(_smooth, (3 * size, 1, channels), one_wide[0], taps, True, one_wide[1])
