"""Least-squares factors: inverse rendering knows light and albedo only up to one factor a channel."""

from __future__ import annotations

import numpy as np


class LeastSquaresFactor:
    """The factor per channel that brings predictions nearest to truths, over any number of images."""

    def __init__(self):
        self._product = np.zeros(3)
        self._square = np.zeros(3)

    def add(
        self, prediction: np.ndarray, truth: np.ndarray, weight: np.ndarray | None = None
    ) -> None:
        """Take in linear values [..., 3], weighted by [...]."""
        weight = np.ones(prediction.shape[:-1]) if weight is None else weight
        weight = weight[..., None].astype(np.float64)
        axes = tuple(range(prediction.ndim - 1))
        self._product += (weight * prediction * truth).sum(axes)
        self._square += (weight * prediction * prediction).sum(axes)

    @property
    def value(self) -> np.ndarray:
        """[3]; 1 where the predictions are all zero."""
        known = self._square > 1e-12
        return np.where(known, self._product / np.where(known, self._square, 1), 1.0)
