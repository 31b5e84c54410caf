"""Fused CPU kernels for bilinear lookups of a map on the sphere; `sphere_torch` is their twin.

A map is [3, H, W], places are [H', W', 2] columns in [0, W] and rows in [0, H], texel centres at +0.5.
Columns go on around, and rows beyond a pole half a turn away.
"""

import math

from .compiling import inlined, serial_kernel


@inlined
def wrapped(column, width):
    """A column that is at most once around the map, on it: a modulo takes longer than all else here."""
    if column < 0:
        return column + width
    return column - width if column >= width else column


@inlined
def corners(place, height, width):
    """Rows and columns of the four texels around a place, and how far it is between them."""
    x, y = place[0] - 0.5, place[1] - 0.5
    left, top = math.floor(x), math.floor(y)
    f, g = x - left, y - top
    j0, i0, i1 = int(top), wrapped(int(left), width), wrapped(int(left) + 1, width)
    j1, i2, i3 = j0 + 1, i0, i1
    half = width // 2
    if j0 < 0:
        j0, i0, i1 = 0, wrapped(i0 + half, width), wrapped(i1 + half, width)
    if j1 >= height:
        j1, i2, i3 = height - 1, wrapped(i2 + half, width), wrapped(i3 + half, width)
    return j0, i0, i1, j1, i2, i3, f, g


@serial_kernel
def look_up(values, places, out):
    """Values [3, H, W] at places, into out [3, H', W']."""
    height, width = values.shape[1:]
    for row in range(places.shape[0]):
        for column in range(places.shape[1]):
            j0, i0, i1, j1, i2, i3, f, g = corners(places[row, column], height, width)
            for c in range(3):
                above = values[c, j0, i0] + f * (values[c, j0, i1] - values[c, j0, i0])
                below = values[c, j1, i2] + f * (values[c, j1, i3] - values[c, j1, i2])
                out[c, row, column] = above + g * (below - above)


@serial_kernel
def look_up_backward(places, cotangent, grad):
    """Add to grad [3, H, W] what the cotangent [3, H', W'] of `look_up` says of the values."""
    height, width = grad.shape[1:]
    for row in range(places.shape[0]):
        for column in range(places.shape[1]):
            j0, i0, i1, j1, i2, i3, f, g = corners(places[row, column], height, width)
            for c in range(3):
                below = g * cotangent[c, row, column]
                above = cotangent[c, row, column] - below
                grad[c, j0, i0] += above - f * above
                grad[c, j0, i1] += f * above
                grad[c, j1, i2] += below - f * below
                grad[c, j1, i3] += f * below
