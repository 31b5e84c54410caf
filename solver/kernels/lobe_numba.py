"""The geometry of a GGX lobe for the kernels: frames, visible normals, Smith's Λ, and their adjoints.

Vectors are tuples of three numbers. What a ray has of its own may be that of eight (`ray_lanes`).
"""

import math

from .angles_numba import cosine_sine_of_turns
from .compiling import function
from .ray_lanes import where
from .vectors_numba import cross, dot, plus

LEAST_VIEW = 1e-3  # cosine to the viewer, at least


@function
def across(g, unit, length):
    """Adjoint of normalising a vector of `length` to `unit`."""
    along = dot(unit, g)
    return (
        (g[0] - along * unit[0]) / length,
        (g[1] - along * unit[1]) / length,
        (g[2] - along * unit[2]) / length,
    )


@function
def frame(n):
    """Tangent and bitangent of a unit normal (Duff et al. 2017)."""
    sign = where(n[2] >= 0.0, 1.0, -1.0)
    a = -1.0 / (sign + n[2])
    c = n[0] * n[1] * a
    return (1.0 + sign * n[0] * n[0] * a, sign * c, -sign * n[0]), (
        c,
        sign + n[1] * n[1] * a,
        -n[1],
    )


@function
def frame_adjoint(n, g_t, g_b):
    sign = 1.0 if n[2] >= 0 else -1.0
    a = -1.0 / (sign + n[2])
    x, y, a2 = n[0], n[1], a * a
    return (
        g_t[0] * 2 * sign * x * a + g_t[1] * sign * y * a - g_t[2] * sign + g_b[0] * y * a,
        g_t[1] * sign * x * a + g_b[0] * x * a + g_b[1] * 2 * y * a - g_b[2],
        g_t[0] * sign * x * x * a2 + g_t[1] * sign * x * y * a2 + g_b[0] * x * y * a2 + g_b[1] * y * y * a2,
    )


@function
def local_view(t, b, n, v):
    """Viewer in the frame, not below LEAST_VIEW, as a unit vector; and the length it had."""
    x, y, z = dot(t, v), dot(b, v), max(dot(n, v), LEAST_VIEW)
    length = math.sqrt(x * x + y * y + z * z)
    return (x / length, y / length, z / length), length


@function
def seen(n, v):
    """Tangent, bitangent, local viewer and its length, of a normal and a viewer."""
    t, b = frame(n)
    view, length = local_view(t, b, n, v)
    return t, b, view, length


@function
def mirrored(view, half):
    """Cosine between viewer and half vector, and the viewer mirrored at it; all local."""
    view_half = dot(view, half)
    return view_half, plus((-view[0], -view[1], -view[2]), 2.0 * view_half, half)


@function
def stretched_frame(view, alpha):
    """Stretched viewer, its two tangents, and what its adjoint needs (Heitz 2018)."""
    x, y, z = alpha * view[0], alpha * view[1], view[2]
    length = max(math.sqrt(x * x + y * y + z * z), 1e-12)
    s = (x / length, y / length, z / length)
    square = max(s[0] * s[0] + s[1] * s[1], 1e-14)
    inverse = 1.0 / math.sqrt(square)
    upright = square <= 1e-12
    t1 = where(upright, 1.0, -s[1] * inverse), where(upright, 0.0, s[0] * inverse), 0.0 * square
    return s, t1, cross(s, t1), length, square, inverse


@function
def smith(cosine, alpha):
    """Smith's Λ."""
    c2 = min(max(cosine * cosine, 1e-8), 1.0)
    return 0.5 * (math.sqrt(1.0 + alpha * alpha * (1.0 - c2) / c2) - 1.0)


@function
def smith_slopes(cosine, alpha):
    """dΛ/dcosine, dΛ/dα."""
    c2 = min(max(cosine * cosine, 1e-8), 1.0)
    ratio = (1.0 - c2) / c2
    slope = 0.25 / math.sqrt(1.0 + alpha * alpha * ratio)
    by_cosine = -alpha * alpha / (c2 * c2) * 2.0 * cosine if 1e-8 < c2 < 1.0 else 0.0
    return slope * by_cosine, slope * 2.0 * alpha * ratio


@function
def half_vector(s, t1, t2, alpha, u0, u1):
    """Half vector of a visible normal, and what its adjoint needs."""
    radius, (cosine, sine) = math.sqrt(u0), cosine_sine_of_turns(u1)
    p1 = radius * cosine
    side, far = radius * sine, math.sqrt(max(1.0 - p1 * p1, 0.0))
    share = 0.5 * (1.0 + s[2])
    p2 = (1.0 - share) * far + share * side
    p3 = math.sqrt(max(1.0 - p1 * p1 - p2 * p2, 1e-12))
    flat = plus(plus((p1 * t1[0], p1 * t1[1], p1 * t1[2]), p2, t2), p3, s)
    x, y, z = alpha * flat[0], alpha * flat[1], max(flat[2], 1e-7)
    length = math.sqrt(x * x + y * y + z * z)
    return (x / length, y / length, z / length), length, flat, p1, p2, p3, side - far


@function
def to_world(t, b, n, local):
    x = t[0] * local[0] + b[0] * local[1] + n[0] * local[2]
    y = t[1] * local[0] + b[1] * local[1] + n[1] * local[2]
    z = t[2] * local[0] + b[2] * local[1] + n[2] * local[2]
    length = math.sqrt(x * x + y * y + z * z)
    return (x / length, y / length, z / length), length


@function
def power5(x):
    return x * x * x * x * x
