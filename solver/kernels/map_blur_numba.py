"""A blur of the light's map, on the CPU; `light.smoothing` has the plain twin.

Torch takes as long for it as for half a step of a fit: its convolutions are made for many channels.
"""

import numba
import numpy as np

from .compiling import kernel


@kernel
def blur(maps, taps, out):
    """Odd, symmetric taps down the columns of maps [C, H, W], whose first and last row go on beyond the
    poles, and along their rows, which go around."""
    channels, height, width = maps.shape
    reach = len(taps) // 2
    for task in numba.prange(channels * height):
        c, i = task // height, task % height
        line = np.empty(width + 2 * reach, np.float32)
        inner = line[reach : reach + width]
        here = maps[c, i]
        for j in range(width):
            inner[j] = taps[reach] * here[j]
        for away in range(1, reach + 1):
            weight = taps[reach + away]
            above, below = maps[c, max(i - away, 0)], maps[c, min(i + away, height - 1)]
            for j in range(width):
                inner[j] += weight * (above[j] + below[j])
        for beyond in range(reach):
            line[reach - 1 - beyond] = inner[width - 1 - beyond % width]
            line[reach + width + beyond] = inner[beyond % width]
        into = out[c, i]
        for j in range(width):
            into[j] = taps[reach] * inner[j]
        for away in range(1, reach + 1):
            weight = taps[reach + away]
            left, right = line[reach - away :], line[reach + away :]
            for j in range(width):
                into[j] += weight * (left[j] + right[j])
