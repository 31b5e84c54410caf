"""Errors of normal maps."""

import numpy as np


def angles(prediction: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Angles in degrees [...] between vectors [..., 3]; 90 where the prediction is zero."""
    length = np.linalg.norm(prediction, axis=-1) * np.linalg.norm(truth, axis=-1)
    cosine = (prediction * truth).sum(-1) / np.maximum(length, 1e-12)
    missing = np.linalg.norm(prediction, axis=-1) < 1e-6
    return np.where(missing, 90.0, np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def normal_mae(prediction: np.ndarray, truth: np.ndarray, alpha: np.ndarray) -> float:
    """Mean angular error in degrees, weighted by the truth's alpha [H, W], 90° where missing."""
    return float((angles(prediction, truth) * alpha).sum() / alpha.sum())


def normal_mae_masked(prediction: np.ndarray, truth: np.ndarray, alpha: np.ndarray) -> float | None:
    """The same over the pixels that are fully the object's and where there is a prediction.

    What errors of the silhouette are left out; None if there is no such pixel.
    """
    inside = (alpha > 0.999) & (np.linalg.norm(prediction, axis=-1) > 1e-6)
    return float(angles(prediction, truth)[inside].mean()) if inside.any() else None
