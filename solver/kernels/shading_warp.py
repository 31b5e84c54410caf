"""Shading of samples in Warp, for CUDA, a thread a row; Warp derives the adjoints.

Plain torch, their twin, stands where each is called (see `pointwise`). Kernels take what has gradients,
then what has none, numbers, and what they write.
"""

import warp as wp

from .lobe_warp import PI, fresnel_power, masked_share, reflected, solid_angle_of, to_world
from .vectors_warp import (
    Grid,
    Integers,
    Numbers,
    Vectors,
    distance,
    held,
    mean_distance,
    saturating,
    vector,
)


@wp.func
def sigmoid(x: float):
    return 1.0 / (1.0 + wp.exp(-x))


@wp.kernel
def materials(logits: Vectors, least_alpha: float, albedo: Vectors, alpha: Numbers, f0: Vectors):
    """Albedo, α and F0 of the heads' numbers [N, 7], before their sigmoid; see `field.heads`."""
    n = wp.tid()
    for c in range(3):
        albedo[n, c] = sigmoid(logits[n, c])
        f0[n, c] = sigmoid(logits[n, 3 + c])
    roughness = sigmoid(logits[n, 6])
    alpha[n] = wp.max(roughness * roughness, least_alpha)


@wp.kernel
def smoothness(
    normals: Vectors, near: Vectors, beyond: Vectors, alpha: Numbers, near_alpha: Numbers,
    albedo: Vectors, near_albedo: Vectors, f0: Vectors, near_f0: Vectors, gloss_roughness: float,
    crease: float, same_colour: float, even_roughness: float, even_f0: float, bends: Numbers,
    unevenness: Numbers,
):  # fmt: skip
    """`render.smoothness.smoothness`, of what it looked up."""
    n = wp.tid()
    lone = vector(near, n) + vector(beyond, n) - 2.0 * vector(normals, n)
    roughness = wp.sqrt(alpha[n])
    gloss = wp.exp(-held(roughness) / gloss_roughness)
    bends[n] = gloss * saturating(0.25 * wp.dot(lone, lone), crease)
    of_albedo = mean_distance(vector(near_albedo, n), vector(albedo, n))
    of_f0 = mean_distance(vector(near_f0, n), vector(f0, n))
    counts = 1.0 + (even_roughness - 1.0) * wp.exp(-held(of_albedo + of_f0) / same_colour)
    of_roughness = distance(wp.sqrt(near_alpha[n]), roughness)
    unevenness[n] = of_albedo + even_f0 * of_f0 + counts * of_roughness


@wp.kernel
def diffuse(
    normals: Vectors, f0: Vectors, albedo: Vectors, light: Vectors, view: Vectors, radiance: Vectors,
    toward: Vectors,
):  # fmt: skip
    """Diffuse radiance of samples under irradiance `light`, and their normals on the viewer's side; see
    `render.shade`."""
    n = wp.tid()
    normal = vector(normals, n)
    facing = wp.dot(normal, vector(view, n))
    away = wp.clamp(1.0 - distance(facing, 0.0), 1.0e-12, 1.0)
    passing = 1.0 - (0.0271 * wp.pow(away, 2.65) + 0.0005)
    side = wp.where(facing < 0.0, -1.0, 1.0)
    for c in range(3):
        radiance[n, c] = (1.0 - f0[n, c]) * passing * albedo[n, c] * light[n, c] / PI
        toward[n, c] = side * normal[c]


@wp.kernel
def outward(gradient: Vectors, least: float, normals: Vectors):
    """Unit vectors against gradients, shorter where those are below `least`; see `field.normals`."""
    n = wp.tid()
    along = vector(gradient, n)
    unit = along / wp.max(wp.length(along), least)
    for c in range(3):
        normals[n, c] = -unit[c]


@wp.kernel(enable_backward=False)
def pixel_edges(
    normals: Vectors, view: Vectors, points: Vectors, distance: Numbers, angle: Numbers,
    least_cosine: float, slid: Grid,
):  # fmt: skip
    """World points [S, 2, 3] a pixel beside each sample on its tangent plane; see `render.footprint`."""
    n = wp.tid()
    normal = vector(normals, n)
    toward = vector(view, n)
    facing = wp.dot(normal, toward)
    slope = wp.max(wp.abs(facing), least_cosine) * wp.where(facing < 0.0, -1.0, 1.0)
    for edge in range(2):
        along = to_world(toward, wp.vec3(1.0 - float(edge), float(edge), 0.0))
        along = along - wp.dot(along, normal) / slope * toward
        for c in range(3):
            slid[n, edge, c] = points[n, c] + angle[n] * distance[n] * along[c]


@wp.kernel(enable_backward=False)
def mirrored_edges(normals: Vectors, view: Vectors, other: Grid, angle: Numbers, spread: Grid):
    """How mirrored directions differ across a pixel [S, 2, 3], with normals `other` at its edges."""
    n = wp.tid()
    normal = vector(normals, n)
    toward = vector(view, n)
    for edge in range(2):
        bend = wp.vec3(other[n, edge, 0], other[n, edge, 1], other[n, edge, 2]) - normal
        turn = angle[n] * to_world(toward, wp.vec3(1.0 - float(edge), float(edge), 0.0))
        change = wp.dot(turn, normal) - wp.dot(toward, bend)
        found = turn - 2.0 * change * normal + 2.0 * wp.dot(normal, toward) * bend
        for c in range(3):
            spread[n, edge, c] = found[c]


@wp.kernel
def scattered(
    normals: Vectors, alpha: Numbers, f0: Vectors, view: Vectors, share: Numbers, counts: Integers,
    sample: Integers, u: Vectors, masking: bool, averaged: bool, half_vectors: Vectors, lights: Vectors,
    directions: Vectors, weights: Vectors, solid_angles: Numbers,
):  # fmt: skip
    """Secondary rays [K]: local half vectors and directions, world directions, weights without g, and the
    solid angles they stand for; see `render.reflection.scatter`."""
    k = wp.tid()
    s = int(sample[k])
    n = vector(normals, s)
    local, half, light = reflected(n, vector(view, s), alpha[s], u[k, 0], u[k, 1])
    direction = to_world(n, light)
    bent = masked_share(local, light, alpha[s], share[s], masking)
    m5 = fresnel_power(wp.dot(local, half))
    for c in range(3):
        half_vectors[k, c] = half[c]
        lights[k, c] = light[c]
        directions[k, c] = direction[c]
        weights[k, c] = (f0[s, c] + (1.0 - f0[s, c]) * m5) * bent
    solid_angle = float(0.0)
    if averaged:
        solid_angle = solid_angle_of(held(local[2]), held(half[2]), held(alpha[s]), float(counts[s]))
    solid_angles[k] = solid_angle


@wp.func
def harmonics(d: wp.vec3, blur: float, out: Vectors, n: int, first: int):
    """The 25 of `light.spherical_harmonics.sh_basis`, degree l times exp(−l(l + 1)/2 · `blur`), and the
    direction itself."""
    x = d[0]
    y = d[1]
    z = d[2]
    xx = x * x
    yy = y * y
    zz = z * z
    out[n, first] = 0.28209479177387814
    a = wp.exp(-blur)
    out[n, first + 1] = a * 0.4886025119029199 * y
    out[n, first + 2] = a * 0.4886025119029199 * z
    out[n, first + 3] = a * 0.4886025119029199 * x
    b = wp.exp(-3.0 * blur)
    out[n, first + 4] = b * 1.0925484305920792 * x * y
    out[n, first + 5] = b * 1.0925484305920792 * y * z
    out[n, first + 6] = b * 0.31539156525252005 * (3.0 * zz - 1.0)
    out[n, first + 7] = b * 1.0925484305920792 * x * z
    out[n, first + 8] = b * 0.5462742152960396 * (xx - yy)
    c = wp.exp(-6.0 * blur)
    out[n, first + 9] = c * 0.5900435899266435 * y * (3.0 * xx - yy)
    out[n, first + 10] = c * 2.890611442640554 * x * y * z
    out[n, first + 11] = c * 0.4570457994644658 * y * (5.0 * zz - 1.0)
    out[n, first + 12] = c * 0.3731763325901154 * z * (5.0 * zz - 3.0)
    out[n, first + 13] = c * 0.4570457994644658 * x * (5.0 * zz - 1.0)
    out[n, first + 14] = c * 1.445305721320277 * z * (xx - yy)
    out[n, first + 15] = c * 0.5900435899266435 * x * (xx - 3.0 * yy)
    e = wp.exp(-10.0 * blur)
    out[n, first + 16] = e * 2.5033429417967046 * x * y * (xx - yy)
    out[n, first + 17] = e * 1.7701307697799304 * y * z * (3.0 * xx - yy)
    out[n, first + 18] = e * 0.9461746957575601 * x * y * (7.0 * zz - 1.0)
    out[n, first + 19] = e * 0.6690465435572892 * y * z * (7.0 * zz - 3.0)
    out[n, first + 20] = e * 0.10578554691520431 * (35.0 * zz * zz - 30.0 * zz + 3.0)
    out[n, first + 21] = e * 0.6690465435572892 * x * z * (7.0 * zz - 3.0)
    out[n, first + 22] = e * 0.47308734787878004 * (xx - yy) * (7.0 * zz - 1.0)
    out[n, first + 23] = e * 1.7701307697799304 * x * z * (xx - 3.0 * yy)
    out[n, first + 24] = e * 0.6258357354491761 * (xx * (xx - 3.0 * yy) - yy * (3.0 * xx - yy))
    for axis in range(3):
        out[n, first + 25 + axis] = d[axis]


@wp.kernel(enable_backward=False)
def directions_encoded(half: Vectors, light: Vectors, alpha: Numbers, out: Vectors):
    """Attenuated harmonics of local half vectors and directions, each before these [K, 56]; see
    `brdf.neural`."""
    n = wp.tid()
    harmonics(vector(half, n), alpha[n], out, n, 0)
    harmonics(vector(light, n), alpha[n], out, n, 28)
