"""A VM lookup at one point, for the Warp kernels that look up many."""

import warp as wp

from .vectors_warp import Grid, Planes


@wp.struct
class Cell:
    """Where a coordinate lies among the nodes of an axis, and the nodes before and after."""

    before: int
    lower: int
    after: int
    fraction: float


@wp.func
def axis_a(k: int):
    return wp.where(k == 2, 1, 0)


@wp.func
def axis_b(k: int):
    return wp.where(k == 0, 1, 2)


@wp.func
def axis_c(k: int):
    return 2 - k


@wp.func
def cell_of(x: float, size: int):
    cell = Cell()
    clamped = wp.clamp(x, 0.0, float(size - 1))
    cell.lower = wp.min(int(clamped), size - 2)
    cell.before = wp.max(cell.lower - 1, 0)
    cell.after = wp.min(cell.lower + 2, size - 1)
    cell.fraction = clamped - float(cell.lower)
    return cell


@wp.func
def plane_at(planes: Planes, k: int, a: Cell, b: Cell, ch: int):
    u = a.fraction
    v = b.fraction
    i = a.lower
    j = b.lower
    near = planes[k, i, j, ch] * (1.0 - v) + planes[k, i, j + 1, ch] * v
    far = planes[k, i + 1, j, ch] * (1.0 - v) + planes[k, i + 1, j + 1, ch] * v
    return near * (1.0 - u) + far * u


@wp.func
def line_at(lines: Grid, k: int, c: Cell, ch: int):
    return lines[k, c.lower, ch] * (1.0 - c.fraction) + lines[k, c.lower + 1, ch] * c.fraction


@wp.func
def raw_density(point: wp.vec3, planes: Planes, lines: Grid):
    size = planes.shape[1]
    total = float(0.0)
    for k in range(3):
        a = cell_of(point[axis_a(k)], size)
        b = cell_of(point[axis_b(k)], size)
        c = cell_of(point[axis_c(k)], size)
        for ch in range(planes.shape[3]):
            total += plane_at(planes, k, a, b, ch) * line_at(lines, k, c, ch)
    return total
