"""Shading of samples on the CPU, a row at a time, and the adjoints.

Plain torch, their twin, stands where each is called (see `pointwise`). Kernels take what has gradients,
then what has none, numbers, and what they write; adjoints take the outputs' cotangents after these, and
last what they write, the cotangents g_x of what has gradients.
"""

import math

import numpy as np

from .compiling import function, serial_kernel
from .lobe_numba import frame
from .vectors_numba import dot, minus, plus, row, times, triple


@function
def saturating(square, spread):
    """`render.smoothness.saturating`."""
    return square / (square + spread * spread)


@function
def saturating_slope(square, spread):
    """Its derivative by the square."""
    return spread * spread / (square + spread * spread) ** 2


@function
def put(values, n, vector):
    values[n, 0], values[n, 1], values[n, 2] = vector


@function
def sigmoid(x):
    return 1.0 / (1.0 + math.exp(-x))


@serial_kernel
def materials(logits, least_alpha, albedo, alpha, f0):
    """Albedo, α and F0 of the heads' numbers [N, 7], before their sigmoid; see `field.heads`."""
    for n in range(logits.shape[0]):
        for c in range(3):
            albedo[n, c] = sigmoid(logits[n, c])
            f0[n, c] = sigmoid(logits[n, 3 + c])
        roughness = sigmoid(logits[n, 6])
        alpha[n] = max(roughness * roughness, least_alpha)


@serial_kernel
def materials_backward(logits, least_alpha, albedo, alpha, f0, g_albedo, g_alpha, g_f0, g_logits):
    for n in range(logits.shape[0]):
        for c in range(3):
            g_logits[n, c] = g_albedo[n, c] * albedo[n, c] * (1.0 - albedo[n, c])
            g_logits[n, 3 + c] = g_f0[n, c] * f0[n, c] * (1.0 - f0[n, c])
        roughness = sigmoid(logits[n, 6])
        slope = 2.0 * roughness * roughness * (1.0 - roughness)
        g_logits[n, 6] = 0.0 if roughness * roughness < least_alpha else g_alpha[n] * slope


@function
def _gloss_and_lone(normals, near, beyond, alpha, gloss_roughness, n):
    """By how much a bend counts, and by what the normal differs from those on both sides."""
    around = plus(row(near, n), 1.0, row(beyond, n))
    return math.exp(-math.sqrt(alpha[n]) / gloss_roughness), plus(around, -2.0, row(normals, n))


@function
def _step(here, near, n):
    """The step of a colour to a point close by."""
    total = 0.0
    for c in range(3):
        total += abs(near[n, c] - here[n, c])
    return total / 3.0


@serial_kernel
def smoothness(
    normals, near, beyond, alpha, near_alpha, albedo, near_albedo, f0, near_f0, gloss_roughness, crease,
    same_colour, even_roughness, even_f0, bends, unevenness,
):  # fmt: skip
    """`render.smoothness.smoothness`, of what it looked up."""
    for n in range(normals.shape[0]):
        gloss, lone = _gloss_and_lone(normals, near, beyond, alpha, gloss_roughness, n)
        bends[n] = gloss * saturating(0.25 * dot(lone, lone), crease)
        of_albedo, of_f0 = _step(albedo, near_albedo, n), _step(f0, near_f0, n)
        counts = 1.0 + (even_roughness - 1.0) * math.exp(-(of_albedo + of_f0) / same_colour)
        of_roughness = abs(math.sqrt(near_alpha[n]) - math.sqrt(alpha[n]))
        unevenness[n] = of_albedo + even_f0 * of_f0 + counts * of_roughness


@serial_kernel
def smoothness_backward(
    normals, near, beyond, alpha, near_alpha, albedo, near_albedo, f0, near_f0, gloss_roughness, crease,
    same_colour, even_roughness, even_f0, bends, unevenness, g_bends, g_unevenness, g_normals, g_near,
    g_beyond, g_alpha, g_near_alpha, g_albedo, g_near_albedo, g_f0, g_near_f0,
):  # fmt: skip
    for n in range(normals.shape[0]):
        gloss, lone = _gloss_and_lone(normals, near, beyond, alpha, gloss_roughness, n)
        slope = g_bends[n] * gloss * saturating_slope(0.25 * dot(lone, lone), crease)
        to_lone = times(0.5 * slope, lone)
        put(g_near, n, to_lone)
        put(g_beyond, n, to_lone)
        put(g_normals, n, times(-2.0, to_lone))
        third = g_unevenness[n] / 3.0
        for c in range(3):
            g_near_albedo[n, c] = third * np.sign(near_albedo[n, c] - albedo[n, c])
            g_albedo[n, c] = -g_near_albedo[n, c]
            g_near_f0[n, c] = even_f0 * third * np.sign(near_f0[n, c] - f0[n, c])
            g_f0[n, c] = -g_near_f0[n, c]
        of_albedo, of_f0 = _step(albedo, near_albedo, n), _step(f0, near_f0, n)
        counts = 1.0 + (even_roughness - 1.0) * math.exp(-(of_albedo + of_f0) / same_colour)
        here, there = math.sqrt(alpha[n]), math.sqrt(near_alpha[n])
        to_step = g_unevenness[n] * counts * np.sign(there - here)
        g_near_alpha[n] = 0.5 * to_step / there
        g_alpha[n] = -0.5 * to_step / here


BLOCKED, BLOCKED_POWER, BLOCKED_LEAST = 0.0271, 2.65, 0.0005
"""of the hemispherical mean of (1 − v·h)^5; see `render.shade.diffuse_fresnel`"""


@serial_kernel
def diffuse(normals, f0, albedo, light, view, radiance, toward):
    """Diffuse radiance of samples under irradiance `light`, and their normals on the viewer's side; see
    `render.shade`."""
    for n in range(normals.shape[0]):
        normal = row(normals, n)
        facing = dot(normal, row(view, n))
        away = max(1.0 - abs(facing), 0.0)
        passing = (1.0 - BLOCKED * away**BLOCKED_POWER - BLOCKED_LEAST) / math.pi
        for c in range(3):
            radiance[n, c] = (1.0 - f0[n, c]) * passing * albedo[n, c] * light[n, c]
        put(toward, n, times(-1.0 if facing < 0.0 else 1.0, normal))


@serial_kernel
def diffuse_backward(
    normals, f0, albedo, light, view, radiance, toward, g_radiance, g_toward, g_normals, g_f0, g_albedo,
    g_light, g_view,
):  # fmt: skip
    for n in range(normals.shape[0]):
        normal, viewer = row(normals, n), row(view, n)
        facing = dot(normal, viewer)
        away = max(1.0 - abs(facing), 0.0)
        steep = BLOCKED * away ** (BLOCKED_POWER - 1.0)
        passing = (1.0 - steep * away - BLOCKED_LEAST) / math.pi
        to_passing = 0.0
        for c in range(3):
            reaching, g = 1.0 - f0[n, c], g_radiance[n, c]
            g_f0[n, c] = -g * passing * albedo[n, c] * light[n, c]
            g_albedo[n, c] = g * reaching * passing * light[n, c]
            g_light[n, c] = g * reaching * passing * albedo[n, c]
            to_passing += g * reaching * albedo[n, c] * light[n, c]
        side = -1.0 if facing < 0.0 else 1.0
        # Not of |n·v| at 0, which has none: a normal without a slope would be given one.
        to_facing = np.sign(facing) * to_passing / math.pi * BLOCKED_POWER * steep
        put(g_normals, n, plus(times(to_facing, viewer), side, row(g_toward, n)))
        put(g_view, n, times(to_facing, normal))


@serial_kernel
def outward(gradient, least, normals):
    """Unit vectors against gradients, shorter where those are below `least`; see `field.normals`."""
    for n in range(gradient.shape[0]):
        along = row(gradient, n)
        put(normals, n, times(-1.0 / max(math.sqrt(dot(along, along)), least), along))


@serial_kernel
def outward_backward(gradient, least, normals, g_normals, g_gradient):
    for n in range(gradient.shape[0]):
        along, g = row(gradient, n), row(g_normals, n)
        length = math.sqrt(dot(along, along))
        if length >= least:
            unit = row(normals, n)
            g = plus(g, -dot(unit, g), unit)
        put(g_gradient, n, times(-1.0 / max(length, least), g))


@function
def _slid(edge, normal, slope, toward):
    """An edge of a pixel, slid along the view onto the surface's tangent plane."""
    return plus(edge, -dot(edge, normal) / slope, toward)


@serial_kernel
def pixel_edges(normals, view, points, distance, angle, least_cosine, slid):
    """World points [S, 2, 3] a pixel beside each sample on its tangent plane; see `render.footprint`."""
    for n in range(normals.shape[0]):
        normal, toward, point = row(normals, n), row(view, n), row(points, n)
        facing, far = dot(normal, toward), angle[n] * distance[n]
        slope = max(abs(facing), least_cosine) * (-1.0 if facing < 0.0 else 1.0)
        across, up = frame(toward)
        put(slid[n], 0, plus(point, far, _slid(across, normal, slope, toward)))
        put(slid[n], 1, plus(point, far, _slid(up, normal, slope, toward)))


@function
def _mirrored_edge(edge, other, normal, toward, angle):
    """How a mirrored direction differs at a pixel's edge, where the normal is `other`."""
    bend, turn = minus(other, normal), times(angle, edge)
    change = dot(turn, normal) - dot(toward, bend)
    found = plus(turn, -2.0 * change, normal)
    return plus(found, 2.0 * dot(normal, toward), bend)


@serial_kernel
def mirrored_edges(normals, view, other, angle, spread):
    """How mirrored directions differ across a pixel [S, 2, 3], with normals `other` at its edges."""
    for n in range(normals.shape[0]):
        normal, toward = row(normals, n), row(view, n)
        across, up = frame(toward)
        put(spread[n], 0, _mirrored_edge(across, triple(other, n, 0), normal, toward, angle[n]))
        put(spread[n], 1, _mirrored_edge(up, triple(other, n, 1), normal, toward, angle[n]))


@serial_kernel
def lifted(normals, points, reach, sample, direction, least_cosine, farthest, origins, start):
    """Where rays [K] of samples begin, above the surface; see `render.reflection.secondary_origins`."""
    for k in range(sample.shape[0]):
        s = sample[k]
        normal = row(normals, s)
        put(origins, k, plus(row(points, s), reach[s], normal))
        cosine = max(dot(normal, row(direction, k)), least_cosine)
        start[k] = reach[s] * min(1.0 / cosine - 1.0, farthest)
