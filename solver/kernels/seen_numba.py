"""What rays see of a few chosen samples, on the CPU; `render.depths` has the plain twin."""

from .compiling import serial_kernel


@serial_kernel
def seen(values, ray, share, opacity, mean, out):
    """The mean of what chosen samples show [K, C], ray by ray [R, C], and that by the rays' opacity."""
    mean[:] = 0.0
    for k in range(values.shape[0]):
        for c in range(values.shape[1]):
            mean[ray[k], c] += share[k] * values[k, c]
    for r in range(mean.shape[0]):
        for c in range(mean.shape[1]):
            out[r, c] = opacity[r] * mean[r, c]


@serial_kernel
def seen_backward(
    values, ray, share, opacity, mean, weights, index, least, others, cotangent, g_values, g_opacity,
    g_weights,
):  # fmt: skip
    """Cotangents of values, opacity and of the weights [S] of all samples, by which `index` were drawn.

    The share of a drawn sample has the gradient of the logarithm of its weight, times what it shows more
    than the mean of the ray's `others`. That of the opacity's logarithm is none: shares sum to one.
    """
    for r in range(mean.shape[0]):
        g_opacity[r] = 0.0
        for c in range(mean.shape[1]):
            g_opacity[r] += cotangent[r, c] * mean[r, c]
    for k in range(values.shape[0]):
        r = ray[k]
        more = 0.0
        for c in range(values.shape[1]):
            g = cotangent[r, c] * opacity[r] * share[k]
            g_values[k, c] = g
            more += g * (values[k, c] - mean[r, c])
        if weights[index[k]] >= least:
            g_weights[index[k]] += others * more / weights[index[k]]
