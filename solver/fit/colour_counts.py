"""How often colours occur in photos, and so how likely a pixel is one of theirs."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

BINS = 24
"""per axis of CIE Lab"""
LOWEST = np.array([0, -80, -80], np.float32)
RANGE = np.array([100, 160, 160], np.float32)
BLUR = 0.8
"""bins over which a colour is spread"""


@dataclass(frozen=True, eq=False)
class ColourCounts:
    """`share` [B, B, B] of all pixels in each bin."""

    share: np.ndarray

    @classmethod
    def of(cls, photos: Iterable[np.ndarray]) -> "ColourCounts":
        """Of pixels [N, 3] CIE Lab of each photo."""
        counts = np.zeros(BINS**3)
        for pixels in photos:
            counts += np.bincount(_bins(pixels), minlength=len(counts))
        counts = ndimage.gaussian_filter(counts.reshape((BINS,) * 3), BLUR) + 1e-3
        return cls(counts / counts.sum())

    def likelihood(self, pixels: np.ndarray) -> np.ndarray:
        """[...] of pixels [..., 3] CIE Lab."""
        return self.share.ravel()[_bins(pixels)]


def _bins(pixels: np.ndarray) -> np.ndarray:
    place = ((pixels - LOWEST) / RANGE * BINS).clip(0, BINS - 1).astype(np.int32)
    return (place[..., 0] * BINS + place[..., 1]) * BINS + place[..., 2]
