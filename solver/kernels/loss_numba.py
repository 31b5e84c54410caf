"""Losses of pixels on the CPU, and priors of materials, a row at a time, and the adjoints.

Plain torch, their twin, stands where each is called (see `pointwise`). Arguments are as in `shading_numba`.
"""

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
def _shown(radiance, opacity, behind):
    """A pixel's channel over what is behind it, and its slopes by radiance and by opacity."""
    share = min(max(opacity, 0.0), 1.0)
    divisor = max(share, LEAST_SHARE)
    encoded, slope = _encoded(radiance / divisor)
    by_radiance = share * slope / divisor
    by_opacity = encoded - behind
    if share >= LEAST_SHARE:
        by_opacity -= by_radiance * radiance / divisor
    if not 0.0 <= opacity <= 1.0:
        by_opacity = 0.0
    return encoded * share + (1.0 - share) * behind, by_radiance, by_opacity


@function
def _error_and_step(seen, mean, n, c, colour, alpha, clipped, behind):
    """How much too bright a pixel is, where that is not forgiven, half the step between its halves, and the
    slopes of what is shown of the pixel."""
    shown, by_radiance, by_opacity = _shown(mean[c], mean[3], behind[n, c])
    error = shown - (colour[n, c] * alpha[n] + (1.0 - alpha[n]) * behind[n, c])
    if clipped[n, c] and error > 0.0 and alpha[n] > OPAQUE:
        return 0.0, 0.0, by_radiance, by_opacity
    last = seen.shape[1] - 1
    if last == 0:
        return error, 0.0, by_radiance, by_opacity
    one, _, _ = _shown(seen[n, 0, c], seen[n, 0, 3], behind[n, c])
    other, _, _ = _shown(seen[n, last, c], seen[n, last, 3], behind[n, c])
    return error, 0.5 * (one - other), by_radiance, by_opacity


@function
def _mean(seen, n):
    """Radiance and opacity of a pixel, from those of its halves."""
    last = seen.shape[1] - 1
    return (
        0.5 * (seen[n, 0, 0] + seen[n, last, 0]), 0.5 * (seen[n, 0, 1] + seen[n, last, 1]),
        0.5 * (seen[n, 0, 2] + seen[n, last, 2]), 0.5 * (seen[n, 0, 3] + seen[n, last, 3]),
    )  # fmt: skip


@serial_kernel
def pixel_loss(
    seen, backfacing, bending, unevenness, colour, alpha, alpha_known, clipped, behind,
    by_opacity, by_backfacing, by_mask, by_bending, by_unevenness, image, shape,
):  # fmt: skip
    """How unlike its photo a pixel before a plain colour is, and the weighted sum of what else is held
    against it; see `fit.losses`."""
    for n in range(seen.shape[0]):
        mean = _mean(seen, n)
        total = 0.0
        for c in range(3):
            error, step, _, _ = _error_and_step(seen, mean, n, c, colour, alpha, clipped, behind)
            total += error * error - step * step
        image[n] = total / 3.0
        missing = mean[3] - alpha[n] if alpha_known[n] else 0.0
        shape[n] = (
            by_opacity * mean[3] + by_backfacing * backfacing[n] + by_mask * missing * missing
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
        mean = _mean(seen, n)
        missing = mean[3] - alpha[n] if alpha_known[n] else 0.0
        to_opacity = g_shape[n] * (by_opacity + 2.0 * by_mask * missing) / halves
        for half in range(halves):
            g_seen[n, half, 3] = to_opacity
        for c in range(3):
            error, step, by_radiance, by_share = _error_and_step(
                seen, mean, n, c, colour, alpha, clipped, behind
            )
            g = g_image[n] * 2.0 / 3.0
            to_each = g * error / halves
            for half in range(halves):
                g_seen[n, half, c] = to_each * by_radiance
                g_seen[n, half, 3] += to_each * by_share
                if step != 0.0:
                    _, own_radiance, own_share = _shown(seen[n, half, c], seen[n, half, 3], behind[n, c])
                    away = g * (-0.5 * step if half == 0 else 0.5 * step)
                    g_seen[n, half, c] += away * own_radiance
                    g_seen[n, half, 3] += away * own_share
        g_backfacing[n] = g_shape[n] * by_backfacing
        g_bending[n] = g_shape[n] * by_bending
        g_unevenness[n] = g_shape[n] * by_unevenness


@serial_kernel
def off_palette(albedo, mean, share, spread, half, loss):
    """How unlike a pixel's albedo is to that of another half a batch away; see `fit.priors`."""
    norm = max(mean[0] * mean[0], LEAST_SQUARE)
    for n in range(albedo.shape[0]):
        other = (n - half) % albedo.shape[0]
        step = minus(row(albedo, n), row(albedo, other))
        loss[n] = share[n] * share[other] * saturating(dot(step, step) / 3.0 / norm, spread)


@serial_kernel
def off_palette_backward(albedo, mean, share, spread, half, loss, g_loss, g_albedo, g_mean):
    norm = max(mean[0] * mean[0], LEAST_SQUARE)
    g_albedo[:] = 0.0
    to_norm = 0.0
    for n in range(albedo.shape[0]):
        other = (n - half) % albedo.shape[0]
        step = minus(row(albedo, n), row(albedo, other))
        square = dot(step, step) / 3.0 / norm
        to_square = g_loss[n] * share[n] * share[other] * saturating_slope(square, spread)
        to_step = times(2.0 / 3.0 * to_square / norm, step)
        put(g_albedo, n, plus(row(g_albedo, n), 1.0, to_step))
        put(g_albedo, other, plus(row(g_albedo, other), -1.0, to_step))
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
