"""Least-squares factors: inverse rendering knows light and albedo only up to one factor a channel."""

import numpy as np
import scipy.optimize


class LeastSquaresFactor:
    """The factor per channel that brings predictions nearest to truths, over any number of images."""

    def __init__(self):
        self._product = np.zeros(3)
        self._square = np.zeros(3)

    def add(self, prediction: np.ndarray, truth: np.ndarray, weight: np.ndarray | None = None) -> None:
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

    @property
    def common(self) -> float:
        """One factor for all channels."""
        square = float(self._square.sum())
        return float(self._product.sum()) / square if square > 1e-12 else 1.0


def clipped_factor(prediction: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """The factor [3] that minimises Σ (clip(factor · prediction) − clip(truth))² of pixels [N, 3].

    Values are linear and clipped to [0, 1], as they are seen. Without the clipping, the few pixels of
    a lamp's reflection decide alone, and a mirror's relighting gets worse by its factor.
    """
    result = np.ones(3)
    for channel in range(3):
        p, t = prediction[:, channel].astype(np.float64), np.clip(truth[:, channel], 0, 1)

        def error(exponent, p=p, t=t):
            return np.mean((np.clip(2.0**exponent * p, 0, 1) - t) ** 2)

        # Clipping makes several valleys possible: look around first.
        grid = np.linspace(-4, 4, 33)
        best = grid[np.argmin([error(x) for x in grid])]
        found = scipy.optimize.minimize_scalar(
            error, bounds=(best - 0.25, best + 0.25), method="bounded", options={"xatol": 1e-4}
        )
        result[channel] = 2.0**found.x
    return result
