"""Losses of pixels in Warp, for CUDA, and priors of materials, a thread a row; Warp derives the adjoints.

Plain torch, their twin, stands where each is called (see `pointwise`). Kernels take what has gradients,
then what has none, numbers, and what they write.
"""

import warp as wp

from .vectors_warp import Grid, Numbers, Vectors, held, largest, mean_square, saturating, vector


@wp.func
def linear_to_srgb(linear: float):
    """`render.tonemap.linear_to_srgb`."""
    curve = 1.055 * wp.pow(wp.max(linear, 0.0031308), 1.0 / 2.4) - 0.055
    return wp.where(linear <= 0.0031308, 12.92 * linear, curve)


@wp.func
def _shown(radiance: float, opacity: float, behind: float):
    """A pixel's channel over what is behind it."""
    # Not `clamp`, which has no gradient at 0 and 1 themselves, where torch's has.
    share = wp.where(opacity > 1.0, 1.0, wp.where(opacity < 0.0, 0.0, opacity))
    return linear_to_srgb(radiance / wp.max(share, 1.0e-3)) * share + (1.0 - share) * behind


@wp.kernel
def pixel_loss(
    seen: Grid, backfacing: Numbers, bending: Numbers, unevenness: Numbers, colour: Vectors,
    alpha: Numbers, alpha_known: wp.array(dtype=wp.bool), clipped: wp.array2d(dtype=wp.bool),
    behind: Vectors, by_opacity: float, by_backfacing: float, by_mask: float, by_bending: float,
    by_unevenness: float, image: Numbers, shape: Numbers,
):  # fmt: skip
    """How unlike its photo a pixel before a plain colour is, and the weighted sum of what else is held
    against it; see `fit.losses`."""
    n = wp.tid()
    last = seen.shape[1] - 1
    opacity = 0.5 * (seen[n, 0, 3] + seen[n, last, 3])
    total = float(0.0)
    for c in range(3):
        target = colour[n, c] * alpha[n] + (1.0 - alpha[n]) * behind[n, c]
        error = _shown(0.5 * (seen[n, 0, c] + seen[n, last, c]), opacity, behind[n, c]) - target
        one = _shown(seen[n, 0, c], seen[n, 0, 3], behind[n, c])
        step = 0.5 * (one - _shown(seen[n, last, c], seen[n, last, 3], behind[n, c]))
        forgiven = clipped[n, c] and error > 0.0 and alpha[n] > 0.999
        total += wp.where(forgiven, 0.0, error * error - step * step)
    image[n] = total / 3.0
    missing = wp.where(alpha_known[n], opacity - alpha[n], 0.0)
    shape[n] = (
        by_opacity * opacity + by_backfacing * backfacing[n] + by_mask * missing * missing
        + by_bending * bending[n] + by_unevenness * unevenness[n]
    )  # fmt: skip


@wp.kernel
def off_palette(albedo: Vectors, mean: Numbers, share: Numbers, spread: float, half: int, loss: Numbers):
    """How unlike a pixel's albedo is to that of another half a batch away; see `fit.priors`."""
    n = wp.tid()
    other = n - half
    if other < 0:
        other = other + albedo.shape[0]
    step = vector(albedo, n) - vector(albedo, other)
    square = mean_square(step) / wp.max(mean[0] * mean[0], 1.0e-6)
    loss[n] = held(share[n]) * held(share[other]) * saturating(square, spread)


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
