"""Arithmetic of three numbers, vectors and colours alike, for the kernels: tuples, so that they stay in
registers."""

from .compiling import function, inlined
from .lanes import load


@inlined
def triple(values, i, j):
    """values[i, j] of an array [..., ..., 3]."""
    return values[i, j, 0], values[i, j, 1], values[i, j, 2]


@inlined
def row(values, i):
    """values[i] of an array [..., 3]."""
    return values[i, 0], values[i, 1], values[i, 2]


@inlined
def three_of(values, first, like):
    """Three rows of an array from `first` on, as many numbers of each as `like` has."""
    return (
        load(values, (first, 0), like),
        load(values, (first + 1, 0), like),
        load(values, (first + 2, 0), like),
    )


@function
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@function
def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@function
def minus(a, b):
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@function
def times(f, a):
    """f·a."""
    return (f * a[0], f * a[1], f * a[2])


@function
def plus(a, f, b):
    """a + f·b."""
    return (a[0] + f * b[0], a[1] + f * b[1], a[2] + f * b[2])
