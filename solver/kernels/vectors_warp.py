"""Small functions of the kernels in Warp, which derives their adjoints."""

import warp as wp

Numbers = wp.array(dtype=float)
Vectors = wp.array2d(dtype=float)
Grid = wp.array3d(dtype=float)
Planes = wp.array4d(dtype=float)
Integers = wp.array(dtype=wp.int64)
Rows = wp.array2d(dtype=wp.int64)
Codes = wp.array3d(dtype=wp.uint8)


@wp.func
def vector(values: Vectors, n: int):
    return wp.vec3(values[n, 0], values[n, 1], values[n, 2])


@wp.func
def held(x: float):
    """The same number, without gradient."""
    return x


@wp.func_grad(held)
def adj_held(x: float, adj_ret: float):
    pass


@wp.func
def saturating(square: float, spread: float):
    """`render.smoothness.saturating`."""
    return square / (square + spread * spread)


@wp.func
def distance(a: float, b: float):
    """|a − b|, without gradient where both are the same, as in torch."""
    return wp.where(a == b, 0.0, wp.abs(a - b))


@wp.func
def mean_distance(a: wp.vec3, b: wp.vec3):
    return (distance(a[0], b[0]) + distance(a[1], b[1]) + distance(a[2], b[2])) / 3.0


@wp.func
def mean_square(a: wp.vec3):
    return wp.dot(a, a) / 3.0


@wp.func
def largest(a: wp.vec3):
    return wp.max(wp.max(a[0], a[1]), a[2])
