"""Errors of material maps and of the recovered light."""

import numpy as np
import skimage.transform

from ..capture.frames import texel_directions
from .scale import LeastSquaresFactor


def weighted_mae(prediction: np.ndarray, truth: np.ndarray, weight: np.ndarray) -> float:
    """Mean absolute error of values [...] or [..., C], weighted by [...]."""
    error = np.abs(prediction.astype(np.float64) - truth)
    error = error.mean(-1) if error.ndim > weight.ndim else error
    return float((error * weight).sum() / max(weight.sum(), 1e-12))


def environment_errors(
    prediction: np.ndarray, truth: np.ndarray, factor: np.ndarray | None = None
) -> dict[str, float]:
    """How far a recovered light [H, 2H, 3] is from the true one, linear Rec.709, Blender's equirect.

    Args:
        factor: [3] on the prediction; None: the least-squares factor per channel.

    Returns:
        `relative_rmse`: root mean square error over the sphere, as a share of the truth's root mean
        square; `mae_tonemapped`: mean absolute error of x/(1+x), which weighs a sun like a lamp.
    """
    size = prediction.shape[:2]
    if truth.shape[:2] != size:
        truth = skimage.transform.resize(truth, size, order=1, anti_aliasing=True)
    up = texel_directions(*size)[..., 2]
    solid_angle = np.sqrt(np.maximum(1 - up * up, 0))
    if factor is None:
        fitted = LeastSquaresFactor()
        fitted.add(prediction, truth, solid_angle)
        factor = fitted.value
    scaled = prediction * factor
    weight = (solid_angle / solid_angle.sum())[..., None] / 3
    square = (weight * (scaled - truth) ** 2).sum() / (weight * truth**2).sum()
    compressed = np.abs(scaled / (1 + scaled) - truth / (1 + truth))
    return {"relative_rmse": float(np.sqrt(square)), "mae_tonemapped": float((weight * compressed).sum())}
