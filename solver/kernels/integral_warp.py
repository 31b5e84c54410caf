"""Rectangle means of a map on the sphere in Warp, for CUDA; `integral_torch` is the plain twin.

Functions take the arguments of `integral_numba`, as tensors, and do what is said there; a thread takes a
rectangle, its adjoint adds atomically.
"""

import warp as wp

from .vectors_warp import Grid, Vectors
from .warp_device import launched

wp.set_module_options({"enable_backward": False})

Table = wp.array3d(dtype=wp.float64)
HALF = wp.constant(wp.float64(0.5))
ZERO = wp.constant(wp.float64(0.0))
ONE = wp.constant(wp.float64(1.0))
TWO = wp.constant(wp.float64(2.0))


@wp.struct
class Column:
    turns: wp.float64
    texel: int
    fraction: wp.float64


@wp.struct
class Sides:
    """Left and right columns of a rectangle, and those behind a pole, half a turn away."""

    x0: Column
    x1: Column
    far0: Column
    far1: Column


@wp.struct
class Slab:
    """An integral over columns x0..x1 and rows 0..y, and its slopes by y, x1 and x0."""

    value: wp.float64
    by_y: wp.float64
    by_x1: wp.float64
    by_x0: wp.float64


@wp.func
def column_of(x: wp.float64, width: int):
    found = Column()
    found.turns = wp.floor(x / wp.float64(width))
    inside = x - found.turns * wp.float64(width)
    found.texel = wp.clamp(int(inside), 0, width - 1)
    found.fraction = inside - wp.float64(found.texel)
    return found


@wp.func
def row_terms(table: Table, j: int, c: int, x0: Column, x1: Column):
    """Prefix sum of table row j between two columns, and its slopes by x1 and by x0."""
    step0 = table[j, x0.texel + 1, c] - table[j, x0.texel, c]
    step1 = table[j, x1.texel + 1, c] - table[j, x1.texel, c]
    turn = table[j, table.shape[1] - 1, c]
    between = (x1.turns - x0.turns) * turn + table[j, x1.texel, c] - table[j, x0.texel, c]
    return wp.vec3d(between + x1.fraction * step1 - x0.fraction * step0, step1, step0)


@wp.func
def slab(table: Table, c: int, x0: Column, x1: Column, y: wp.float64):
    j = wp.clamp(int(y), 0, table.shape[0] - 2)
    f = y - wp.float64(j)
    top = row_terms(table, j, c, x0, x1)
    change = row_terms(table, j + 1, c, x0, x1) - top
    found = Slab()
    found.value = top[0] + f * change[0]
    found.by_y = change[0]
    found.by_x1 = top[1] + f * change[1]
    found.by_x0 = top[2] + f * change[2]
    return found


@wp.func
def slab_over_poles(table: Table, c: int, at: Sides, y: wp.float64):
    height = wp.float64(table.shape[0] - 1)
    found = Slab()
    if y < ZERO:
        mirrored = slab(table, c, at.far0, at.far1, -y)
        found.value = -mirrored.value
        found.by_y = mirrored.by_y
        found.by_x1 = -mirrored.by_x1
        found.by_x0 = -mirrored.by_x0
    elif y > height:
        near = slab(table, c, at.x0, at.x1, height)
        behind = slab(table, c, at.far0, at.far1, height)
        mirrored = slab(table, c, at.far0, at.far1, TWO * height - y)
        found.value = near.value + behind.value - mirrored.value
        found.by_y = mirrored.by_y
        found.by_x1 = near.by_x1 + behind.by_x1 - mirrored.by_x1
        found.by_x0 = near.by_x0 + behind.by_x0 - mirrored.by_x0
    else:
        found = slab(table, c, at.x0, at.x1, y)
    return found


@wp.func
def row_integral_over_poles(rows: wp.array(dtype=wp.float64), y: wp.float64):
    count = rows.shape[0] - 1
    height = wp.float64(count)
    folded = y
    if y < ZERO:
        folded = -y
    elif y > height:
        folded = TWO * height - y
    j = wp.clamp(int(folded), 0, count - 1)
    slope = rows[j + 1] - rows[j]
    value = rows[j] + (folded - wp.float64(j)) * slope
    if y < ZERO:
        value = -value
    elif y > height:
        value = TWO * rows[count] - value
    return wp.vec2d(value, slope)


@wp.func
def edges_of(centre: Vectors, size: Vectors, n: int, axis: int):
    half = HALF * wp.float64(size[n, axis])
    return wp.vec2d(wp.float64(centre[n, axis]) - half, wp.float64(centre[n, axis]) + half)


@wp.func
def sides_of(centre: Vectors, size: Vectors, n: int, width: int):
    x = edges_of(centre, size, n, 0)
    turn = HALF * wp.float64(width)
    found = Sides()
    found.x0 = column_of(x[0], width)
    found.x1 = column_of(x[1], width)
    found.far0 = column_of(x[0] + turn, width)
    found.far1 = column_of(x[1] + turn, width)
    return found


@wp.kernel
def _rectangle_mean(
    table: Table, rows: wp.array(dtype=wp.float64), centre: Vectors, size: Vectors, out: Vectors,
    slope: Grid,
):  # fmt: skip
    n = wp.tid()
    at = sides_of(centre, size, n, table.shape[1] - 1)
    y = edges_of(centre, size, n, 1)
    columns = wp.float64(size[n, 0])
    below = row_integral_over_poles(rows, y[1])
    above = row_integral_over_poles(rows, y[0])
    area = columns * (below[0] - above[0])
    area_slope = columns * (below[1] - above[1])
    lines_slope = columns * (below[1] + above[1])
    for c in range(3):
        a = slab_over_poles(table, c, at, y[1])
        b = slab_over_poles(table, c, at, y[0])
        mean = (a.value - b.value) / area
        out[n, c] = float(mean)
        slope[n, c, 0] = float(((a.by_x1 - b.by_x1) - (a.by_x0 - b.by_x0)) / area)
        slope[n, c, 1] = float(((a.by_y - b.by_y) - mean * area_slope) / area)
        by_columns = HALF * ((a.by_x1 - b.by_x1) + (a.by_x0 - b.by_x0)) / area
        slope[n, c, 2] = float(by_columns - mean / columns)
        slope[n, c, 3] = float(HALF * ((a.by_y + b.by_y) - mean * lines_slope) / area)


@wp.func
def scatter_row(grad: Table, j: int, x0: Column, x1: Column, g: wp.float64, c: int):
    wp.atomic_add(grad, j, grad.shape[1] - 1, c, (x1.turns - x0.turns) * g)
    wp.atomic_add(grad, j, x1.texel, c, (ONE - x1.fraction) * g)
    wp.atomic_add(grad, j, x1.texel + 1, c, x1.fraction * g)
    wp.atomic_add(grad, j, x0.texel, c, (x0.fraction - ONE) * g)
    wp.atomic_add(grad, j, x0.texel + 1, c, -x0.fraction * g)


@wp.func
def scatter_slab(grad: Table, x0: Column, x1: Column, y: wp.float64, g: wp.float64, c: int):
    j = wp.clamp(int(y), 0, grad.shape[0] - 2)
    f = y - wp.float64(j)
    scatter_row(grad, j, x0, x1, (ONE - f) * g, c)
    scatter_row(grad, j + 1, x0, x1, f * g, c)


@wp.func
def scatter_over_poles(grad: Table, at: Sides, y: wp.float64, g: wp.float64, c: int):
    height = wp.float64(grad.shape[0] - 1)
    if y < ZERO:
        scatter_slab(grad, at.far0, at.far1, -y, -g, c)
    elif y > height:
        scatter_slab(grad, at.x0, at.x1, height, g, c)
        scatter_slab(grad, at.far0, at.far1, height, g, c)
        scatter_slab(grad, at.far0, at.far1, TWO * height - y, -g, c)
    else:
        scatter_slab(grad, at.x0, at.x1, y, g, c)


@wp.kernel
def _rectangle_mean_backward(
    rows: wp.array(dtype=wp.float64), centre: Vectors, size: Vectors, cotangent: Vectors, grad: Table
):
    n, c = wp.tid()
    if cotangent[n, c] == 0.0:
        return
    at = sides_of(centre, size, n, grad.shape[1] - 1)
    y = edges_of(centre, size, n, 1)
    columns = wp.float64(size[n, 0])
    below = row_integral_over_poles(rows, y[1])
    above = row_integral_over_poles(rows, y[0])
    g = wp.float64(cotangent[n, c]) / (columns * (below[0] - above[0]))
    scatter_over_poles(grad, at, y[1], g, c)
    scatter_over_poles(grad, at, y[0], -g, c)


rectangle_mean = launched(_rectangle_mean, "centre")
rectangle_mean_backward = launched(_rectangle_mean_backward, "cotangent", 2)
