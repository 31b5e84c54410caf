"""How sharp a photo is, as a number that photos of one object can be compared by."""

import numpy as np
from scipy import ndimage

FEWEST_PIXELS = 200
"""from which something can be said"""


def sharpness_of(grey: np.ndarray, inside: np.ndarray | None = None) -> float:
    """log2 of fine over middle detail where there is most of the latter; NaN if there is none.

    A ratio at edges: a plain object has few edges, but sharp ones, and a blurred one has soft ones.

    Args:
        grey: [H, W] float32, encoded luminance from 0 to 255. inside: [H, W] bool, where to look; None:
            everywhere.
    """
    inside = np.ones(grey.shape, bool) if inside is None else inside
    rows, columns = inside.nonzero()
    if len(rows) < FEWEST_PIXELS:
        return float("nan")
    window = np.s_[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    grey = grey[window]
    # Along rows and columns each, the softer counts: a shaken photo is sharp across its motion.
    found = [_sharpness_along(grey, inside[window], axis) for axis in (0, 1)]
    return float(np.nanmin(found)) if np.isfinite(found).any() else float("nan")


def _sharpness_along(grey: np.ndarray, inside: np.ndarray, axis: int) -> float:
    soft = ndimage.gaussian_filter1d(grey, 1.0, axis=axis)
    # Second differences: the finest that pixels hold, and the first that goes with any blur.
    fine = ndimage.convolve1d(grey, [-0.25, 0.5, -0.25], axis=axis) ** 2
    middle = (soft - ndimage.gaussian_filter1d(soft, 3.0, axis=axis)) ** 2
    # Both over a neighbourhood: the steepest place of an edge is not where its detail is.
    near = ndimage.uniform_filter(middle, 7)[inside]
    strong = near >= np.percentile(near, 95)
    around = ndimage.uniform_filter(fine, 7)[inside]
    if near[strong].mean() < 1.0:
        return float("nan")
    # What is there in the flattest parts as well is noise.
    there = around[strong].mean() - np.percentile(around, 10)
    return float(np.log2(max(there / near[strong].mean(), 2.0**-12)))
