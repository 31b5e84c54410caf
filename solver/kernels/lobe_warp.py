"""The geometry of a GGX lobe in Warp, which derives the adjoints; `lobe_numba` has both by hand.

All in a sample's own frame, with the normal along +Z, unless said otherwise.
"""

import math

import warp as wp

LEAST_VIEW = wp.constant(1.0e-3)
"""cosine to the viewer, at least"""
PI, TURN = wp.constant(math.pi), wp.constant(2.0 * math.pi)
ABOVE = wp.constant(1.0e-4)
"""cosine from which a reflected direction counts as above the surface"""


@wp.func
def frame(n: wp.vec3):
    sign = wp.where(n[2] >= 0.0, 1.0, -1.0)
    a = -1.0 / (sign + n[2])
    c = n[0] * n[1] * a
    tangent = wp.vec3(1.0 + sign * n[0] * n[0] * a, sign * c, -sign * n[0])
    bitangent = wp.vec3(c, sign + n[1] * n[1] * a, -n[1])
    return tangent, bitangent


@wp.func
def to_world(n: wp.vec3, local: wp.vec3):
    """A unit vector of the frame of a world normal n, in the world."""
    t, b = frame(n)
    return wp.normalize(local[0] * t + local[1] * b + local[2] * n)


@wp.func
def seen_from(n: wp.vec3, v: wp.vec3):
    """The world's unit direction v to the viewer in the frame, not below `LEAST_VIEW`."""
    t, b = frame(n)
    return wp.normalize(wp.vec3(wp.dot(t, v), wp.dot(b, v), wp.max(wp.dot(n, v), LEAST_VIEW)))


@wp.func
def half_vector(view: wp.vec3, alpha: float, u0: float, u1: float):
    """A visible normal (Heitz 2018)."""
    s = wp.normalize(wp.vec3(alpha * view[0], alpha * view[1], view[2]))
    square = wp.max(s[0] * s[0] + s[1] * s[1], 1.0e-14)
    inverse = 1.0 / wp.sqrt(square)
    upright = square <= 1.0e-12
    t1 = wp.vec3(wp.where(upright, 1.0, -s[1] * inverse), wp.where(upright, 0.0, s[0] * inverse), 0.0)
    t2 = wp.cross(s, t1)
    radius = wp.sqrt(u0)
    p1 = radius * wp.cos(TURN * u1)
    side = radius * wp.sin(TURN * u1)
    far = wp.sqrt(wp.max(1.0 - p1 * p1, 0.0))
    share = 0.5 * (1.0 + s[2])
    p2 = (1.0 - share) * far + share * side
    p3 = wp.sqrt(wp.max(1.0 - p1 * p1 - p2 * p2, 1.0e-12))
    flat = p1 * t1 + p2 * t2 + p3 * s
    return wp.normalize(wp.vec3(alpha * flat[0], alpha * flat[1], wp.max(flat[2], 1.0e-7)))


@wp.func
def reflected(n: wp.vec3, v: wp.vec3, alpha: float, u0: float, u1: float):
    """The viewer, a visible normal, and the viewer mirrored at it, all in the frame of a world normal n."""
    view = seen_from(n, v)
    half = half_vector(view, alpha, u0, u1)
    return view, half, 2.0 * wp.dot(view, half) * half - view


@wp.func
def smith(cosine: float, alpha: float):
    c2 = wp.clamp(cosine * cosine, 1.0e-8, 1.0)
    return 0.5 * (wp.sqrt(1.0 + alpha * alpha * (1.0 - c2) / c2) - 1.0)


@wp.func
def masked_share(view: wp.vec3, light: wp.vec3, alpha: float, share: float, masking: bool):
    """A ray's weight without Fresnel's term: its share, by G2/G1 with `masking`; none below the surface."""
    weight = wp.where(light[2] > ABOVE, share, 0.0)
    if masking:
        seen = 1.0 + smith(view[2], alpha)
        weight = weight * seen / (seen + smith(light[2], alpha))
    return weight


@wp.func
def fresnel_power(view_half: float):
    """Schlick's (1 − cos)⁵."""
    m = wp.clamp(1.0 - view_half, 0.0, 1.0)
    return m * m * m * m * m


@wp.func
def solid_angle_of(view_z: float, half_z: float, alpha: float, count: float):
    """The solid angle that one of `count` rays stands for: 1/(N · pdf)."""
    denominator = half_z * half_z * (alpha * alpha - 1.0) + 1.0
    density = alpha * alpha / wp.max(PI * denominator * denominator, 1.0e-20)
    density = density / ((1.0 + smith(view_z, alpha)) * 4.0 * view_z)
    return 1.0 / wp.max(count * density, 1.0e-6)
