"""Shading of samples and priors of pixels in Warp, for CUDA, a thread a row; Warp derives the adjoints.

Each is one launch for what plain torch, its twin, does in dozens: on a card, whose numbers take no time,
launches are what a step waits for. Kernels take what has gradients, numbers, and what they write, in this
order.
"""

from __future__ import annotations

import warp as wp

from .lobe_warp import to_world
from .warp_device import launch, launch_adjoint

Numbers = wp.array(dtype=float)
Vectors = wp.array2d(dtype=float)

PI = wp.constant(3.141592653589793)


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


@wp.kernel
def smoothness(
    normals: Vectors, near: Vectors, beyond: Vectors, alpha: Numbers, near_alpha: Numbers,
    albedo: Vectors, near_albedo: Vectors, f0: Vectors, near_f0: Vectors, gloss_roughness: float,
    crease: float, same_colour: float, even_roughness: float, bends: Numbers, unevenness: Numbers,
):  # fmt: skip
    """`render.smoothness.smoothness`, of what it looked up."""
    n = wp.tid()
    lone = vector(near, n) + vector(beyond, n) - 2.0 * vector(normals, n)
    roughness = wp.sqrt(alpha[n])
    gloss = wp.exp(-held(roughness) / gloss_roughness)
    bends[n] = gloss * saturating(0.25 * wp.dot(lone, lone), crease)
    colours = mean_distance(vector(near_albedo, n), vector(albedo, n))
    colours = colours + mean_distance(vector(near_f0, n), vector(f0, n))
    counts = 1.0 + (even_roughness - 1.0) * wp.exp(-held(colours) / same_colour)
    unevenness[n] = colours + counts * distance(wp.sqrt(near_alpha[n]), roughness)


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
    away = wp.clamp(1.0 - wp.abs(facing), 1.0e-12, 1.0)
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
    least_cosine: float, slid: wp.array3d(dtype=float),
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
def mirrored_edges(
    normals: Vectors, view: Vectors, other: wp.array3d(dtype=float), angle: Numbers,
    spread: wp.array3d(dtype=float),
):  # fmt: skip
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


@wp.func
def linear_to_srgb(linear: float):
    """`render.tonemap.linear_to_srgb`."""
    curve = 1.055 * wp.pow(wp.max(linear, 0.0031308), 1.0 / 2.4) - 0.055
    return wp.where(linear <= 0.0031308, 12.92 * linear, curve)


@wp.kernel
def pixel_loss(
    radiance: Vectors, opacity: Numbers, backfacing: Numbers, bending: Numbers, unevenness: Numbers,
    colour: Vectors, alpha: Numbers, alpha_known: wp.array(dtype=wp.bool),
    clipped: wp.array2d(dtype=wp.bool), behind: Vectors, by_opacity: float, by_backfacing: float,
    by_mask: float, by_bending: float, by_unevenness: float, image: Numbers, shape: Numbers,
):  # fmt: skip
    """How unlike its photo a pixel before a plain colour is, and the weighted sum of what else is held
    against it; see `fit.losses`."""
    n = wp.tid()
    share = wp.clamp(opacity[n], 0.0, 1.0)
    total = float(0.0)
    for c in range(3):
        shown = linear_to_srgb(radiance[n, c] / wp.max(share, 1.0e-3)) * share
        shown = shown + (1.0 - share) * behind[n, c]
        error = shown - (colour[n, c] * alpha[n] + (1.0 - alpha[n]) * behind[n, c])
        forgiven = clipped[n, c] and error > 0.0 and alpha[n] > 0.999
        total += wp.where(forgiven, 0.0, error * error)
    image[n] = total / 3.0
    missing = wp.where(alpha_known[n], opacity[n] - alpha[n], 0.0)
    shape[n] = (
        by_opacity * opacity[n] + by_backfacing * backfacing[n] + by_mask * missing * missing
        + by_bending * bending[n] + by_unevenness * unevenness[n]
    )  # fmt: skip


@wp.kernel
def off_palette(
    albedo: Vectors, opacity: Numbers, mean: Numbers, least_opacity: float, spread: float,
    half: int, loss: Numbers,
):  # fmt: skip
    """How unlike a pixel's albedo is to that of another half a batch away; see `fit.priors`."""
    n = wp.tid()
    other = n - half
    if other < 0:
        other = other + albedo.shape[0]
    own = held(opacity[n])
    others = held(opacity[other])
    step = vector(albedo, n) / wp.max(own, least_opacity)
    step = step - vector(albedo, other) / wp.max(others, least_opacity)
    square = mean_square(step) / wp.max(mean[0] * mean[0], 1.0e-6)
    loss[n] = own * others * saturating(square, spread)


@wp.kernel
def material_priors(
    albedo: Vectors, f0: Vectors, opacity: Numbers, least_opacity: float, dielectric: float,
    dielectric_f0: float, dielectric_spread: float, grey: float, least_metal: float,
    sure_dielectric: float, metal: float, metal_f0: float, cool_spread: float, metal_spread: float,
    metal_albedo: float, sure_metal: float, loss: Numbers,
):  # fmt: skip
    """Weighted priors of pixels' materials, premultiplied by opacity; see `fit.priors`."""
    n = wp.tid()
    through = 1.0 / wp.max(held(opacity[n]), least_opacity)
    shown = vector(f0, n)
    straight = shown * through
    brightest = held(largest(straight))
    usual = dielectric_f0 * held(opacity[n])
    unlike = saturating((shown[0] - usual) * (shown[0] - usual), dielectric_spread)
    unlike += saturating((shown[1] - usual) * (shown[1] - usual), dielectric_spread)
    unlike += saturating((shown[2] - usual) * (shown[2] - usual), dielectric_spread)
    total = dielectric * unlike / 3.0
    middle = (straight[0] + straight[1] + straight[2]) / 3.0
    colour = mean_square(straight - wp.vec3(middle, middle, middle))
    is_dielectric = wp.clamp((least_metal - brightest) / (least_metal - sure_dielectric), 0.0, 1.0)
    total += grey * held(opacity[n]) * is_dielectric * colour
    excess = wp.max(straight[1] - straight[0], straight[2] - wp.min(straight[0], straight[1]))
    coolness = held(wp.max(excess, 0.0) / wp.max(largest(straight), 1.0e-3)) / cool_spread
    cool = coolness * coolness * coolness
    bare = wp.exp(-cool * cool) / (1.0 + wp.exp((least_metal - brightest) / metal_spread))
    missing = metal_f0 - brightest - (middle - held(middle))
    total += metal * bare * missing * missing
    is_metal = 1.0 / (1.0 + wp.exp((sure_metal - brightest) / metal_spread))
    total += metal_albedo * is_metal * mean_square(vector(albedo, n) * through)
    loss[n] = total


ALL = (
    smoothness,
    diffuse,
    outward,
    pixel_edges,
    mirrored_edges,
    pixel_loss,
    off_palette,
    material_priors,
)
KERNELS = {kernel.key.rsplit(".")[-1]: kernel for kernel in ALL}


def run(name: str, inputs, numbers, outputs) -> None:
    """Run a kernel on all rows."""
    launch(KERNELS[name], len(outputs[0]), *inputs, *numbers, *outputs)


def run_adjoint(name: str, inputs, numbers, outputs, to_inputs, from_outputs) -> None:
    """Add to gradients `to_inputs` (or None) what comes of the cotangents of outputs."""
    none = [None] * len(numbers)
    launch_adjoint(
        KERNELS[name], len(outputs[0]), (*inputs, *numbers, *outputs),
        (*to_inputs, *none, *from_outputs),
    )  # fmt: skip
