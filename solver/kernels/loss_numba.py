"""Losses of pixels on the CPU, and priors of materials, a row at a time, and the adjoints.

Plain torch, their twin, stands where each is called (see `pointwise`). Arguments are as in `shading_numba`.
"""

from __future__ import annotations

import math

from .compiling import function, serial_kernel
from .shading_numba import put, saturating, saturating_slope, sigmoid
from .vectors_numba import dot, minus, plus, row, times

LINEAR_END, EXPONENT = 0.0031308, 1.0 / 2.4
"""of the sRGB curve; see `render.tonemap`"""
OPAQUE = 0.999
"""a photo's alpha from which a saturated pixel may be any brighter"""
LEAST_SHARE = 1e-3
"""opacity by which radiance is divided, at least; see `render.tonemap`"""
LEAST_SQUARE = 1e-6
"""of the mean albedo, by which differences are divided; see `fit.priors.off_palette`"""


@function
def _encoded(linear):
    """`render.tonemap.linear_to_srgb`, and its slope."""
    if linear <= LINEAR_END:
        return 12.92 * linear, 12.92
    curve = 1.055 * linear**EXPONENT
    return curve - 0.055, EXPONENT * curve / linear


@function
def _shown(seen, n, half, c, behind):
    """A channel of a half of a pixel's rays, over what is behind them."""
    share = min(max(seen[n, half, 3], 0.0), 1.0)
    encoded, _ = _encoded(seen[n, half, c] / max(share, LEAST_SHARE))
    return encoded * share + (1.0 - share) * behind[n, c]


@function
def _errors(seen, n, c, colour, alpha, clipped, behind):
    """How much too bright the first and the last half of a pixel's rays are, where that is not forgiven."""
    target = colour[n, c] * alpha[n] + (1.0 - alpha[n]) * behind[n, c]
    first = _shown(seen, n, 0, c, behind) - target
    last = _shown(seen, n, seen.shape[1] - 1, c, behind) - target
    if clipped[n, c] and first + last > 0.0 and alpha[n] > OPAQUE:
        return 0.0, 0.0
    return first, last


@function
def _opacity(seen, n):
    """Mean of the halves'."""
    return 0.5 * (seen[n, 0, 3] + seen[n, seen.shape[1] - 1, 3])


@serial_kernel
def pixel_loss(
    seen, backfacing, bending, unevenness, colour, alpha, alpha_known, clipped, behind,
    by_opacity, by_backfacing, by_mask, by_bending, by_unevenness, image, shape,
):  # fmt: skip
    """How unlike its photo a pixel before a plain colour is, and the weighted sum of what else is held
    against it; see `fit.losses`."""
    for n in range(seen.shape[0]):
        total = 0.0
        for c in range(3):
            first, last = _errors(seen, n, c, colour, alpha, clipped, behind)
            total += first * last
        image[n] = total / 3.0
        opacity = _opacity(seen, n)
        missing = opacity - alpha[n] if alpha_known[n] else 0.0
        shape[n] = (
            by_opacity * opacity + by_backfacing * backfacing[n] + by_mask * missing * missing
            + by_bending * bending[n] + by_unevenness * unevenness[n]
        )  # fmt: skip


@serial_kernel
def pixel_loss_backward(
    seen, backfacing, bending, unevenness, colour, alpha, alpha_known, clipped, behind,
    by_opacity, by_backfacing, by_mask, by_bending, by_unevenness, image, shape, g_image, g_shape,
    g_seen, g_backfacing, g_bending, g_unevenness,
):  # fmt: skip
    halves = seen.shape[1]
    for n in range(seen.shape[0]):
        missing = _opacity(seen, n) - alpha[n] if alpha_known[n] else 0.0
        to_opacity = g_shape[n] * (by_opacity + 2.0 * by_mask * missing) / halves
        for half in range(halves):
            opacity = seen[n, half, 3]
            share = min(max(opacity, 0.0), 1.0)
            divisor = max(share, LEAST_SHARE)
            to_share = 0.0
            for c in range(3):
                first, last = _errors(seen, n, c, colour, alpha, clipped, behind)
                g = g_image[n] * 2.0 / 3.0 / halves * (last if half == 0 else first)
                straight = seen[n, half, c] / divisor
                encoded, slope = _encoded(straight)
                to_straight = g * share * slope
                g_seen[n, half, c] = to_straight / divisor
                to_share += g * (encoded - behind[n, c])
                if share >= LEAST_SHARE:
                    to_share -= to_straight * straight / divisor
            g_seen[n, half, 3] = to_opacity + (to_share if 0.0 <= opacity <= 1.0 else 0.0)
        g_backfacing[n] = g_shape[n] * by_backfacing
        g_bending[n] = g_shape[n] * by_bending
        g_unevenness[n] = g_shape[n] * by_unevenness


@function
def _step_of_albedo(albedo, opacity, least_opacity, half, n):
    """The other pixel of a pair, by which both albedos are divided, and how they then differ."""
    other = (n - half) % albedo.shape[0]
    own, others = max(opacity[n], least_opacity), max(opacity[other], least_opacity)
    return (
        other,
        own,
        others,
        minus(times(1 / own, row(albedo, n)), times(1 / others, row(albedo, other))),
    )


@serial_kernel
def off_palette(albedo, mean, opacity, least_opacity, spread, half, loss):
    """How unlike a pixel's albedo is to that of another half a batch away; see `fit.priors`."""
    norm = max(mean[0] * mean[0], LEAST_SQUARE)
    for n in range(albedo.shape[0]):
        other, _, _, step = _step_of_albedo(albedo, opacity, least_opacity, half, n)
        loss[n] = opacity[n] * opacity[other] * saturating(dot(step, step) / 3.0 / norm, spread)


@serial_kernel
def off_palette_backward(
    albedo, mean, opacity, least_opacity, spread, half, loss, g_loss, g_albedo, g_mean
):
    norm = max(mean[0] * mean[0], LEAST_SQUARE)
    g_albedo[:] = 0.0
    to_norm = 0.0
    for n in range(albedo.shape[0]):
        other, own, others, step = _step_of_albedo(albedo, opacity, least_opacity, half, n)
        square = dot(step, step) / 3.0 / norm
        to_square = g_loss[n] * opacity[n] * opacity[other] * saturating_slope(square, spread)
        to_step = times(2.0 / 3.0 * to_square / norm, step)
        put(g_albedo, n, plus(row(g_albedo, n), 1.0 / own, to_step))
        put(g_albedo, other, plus(row(g_albedo, other), -1.0 / others, to_step))
        to_norm -= to_square * square / norm
    g_mean[0] = 2.0 * mean[0] * to_norm if mean[0] * mean[0] >= LEAST_SQUARE else 0.0


@function
def _above(f0, least, spread):
    return sigmoid((f0 - least) / spread)


@function
def _bareness(f0, cool_spread):
    """How likely a bare metal has an F0, by its colour; `fit.priors.unlike_metal`."""
    excess = max(f0[1] - f0[0], f0[2] - min(f0[0], f0[1]), 0.0)
    cool = excess / max(f0[0], f0[1], f0[2], 1e-3) / cool_spread
    return math.exp(-(cool**6))


@serial_kernel
def material_priors(
    albedo, f0, opacity, least_opacity, dielectric, dielectric_f0, dielectric_spread, grey, least_metal,
    sure_dielectric, metal, metal_f0, cool_spread, metal_spread, metal_albedo, sure_metal, loss,
):  # fmt: skip
    """Weighted priors of pixels' materials, premultiplied by opacity; see `fit.priors`."""
    for n in range(f0.shape[0]):
        through, shown = 1.0 / max(opacity[n], least_opacity), row(f0, n)
        straight = times(through, shown)
        brightest = max(straight[0], straight[1], straight[2])
        middle = (straight[0] + straight[1] + straight[2]) / 3.0
        unlike, colour = 0.0, 0.0
        for c in range(3):
            away = f0[n, c] - dielectric_f0 * opacity[n]
            unlike += saturating(away * away, dielectric_spread)
            colour += (f0[n, c] * through - middle) ** 2
        room = (least_metal - brightest) / (least_metal - sure_dielectric)
        is_dielectric = min(max(room, 0.0), 1.0)
        bare = _bareness(straight, cool_spread) * _above(brightest, least_metal, metal_spread)
        diffuse = times(through, row(albedo, n))
        loss[n] = (
            dielectric * unlike + grey * opacity[n] * is_dielectric * colour
            + metal * bare * 3.0 * (metal_f0 - brightest) ** 2
            + metal_albedo * _above(brightest, sure_metal, metal_spread) * dot(diffuse, diffuse)
        ) / 3.0  # fmt: skip


@serial_kernel
def material_priors_backward(
    albedo, f0, opacity, least_opacity, dielectric, dielectric_f0, dielectric_spread, grey, least_metal,
    sure_dielectric, metal, metal_f0, cool_spread, metal_spread, metal_albedo, sure_metal, loss, g_loss,
    g_albedo, g_f0,
):  # fmt: skip
    for n in range(f0.shape[0]):
        through, g = 1.0 / max(opacity[n], least_opacity), g_loss[n] * 2.0 / 3.0
        straight = times(through, row(f0, n))
        brightest = max(straight[0], straight[1], straight[2])
        middle = (straight[0] + straight[1] + straight[2]) / 3.0
        room = (least_metal - brightest) / (least_metal - sure_dielectric)
        by_colour = grey * opacity[n] * min(max(room, 0.0), 1.0)
        bare = _bareness(straight, cool_spread) * _above(brightest, least_metal, metal_spread)
        by_missing = metal * bare * (metal_f0 - brightest)
        by_albedo = metal_albedo * _above(brightest, sure_metal, metal_spread)
        for c in range(3):
            away = f0[n, c] - dielectric_f0 * opacity[n]
            to_shown = dielectric * away * saturating_slope(away * away, dielectric_spread)
            to_straight = by_colour * (f0[n, c] * through - middle) - by_missing
            g_f0[n, c] = g * (to_shown + through * to_straight)
            g_albedo[n, c] = g * by_albedo * through * through * albedo[n, c]
