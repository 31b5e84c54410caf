"""Image metrics."""

from __future__ import annotations

import numpy as np
import skimage.metrics


def psnr(prediction: np.ndarray, truth: np.ndarray) -> float:
    """Peak signal-to-noise ratio in dB of images in [0, 1]."""
    error = np.mean((prediction.astype(np.float64) - truth.astype(np.float64)) ** 2)
    return float("inf") if error == 0 else float(-10 * np.log10(error))


def ssim(prediction: np.ndarray, truth: np.ndarray) -> float:
    """Structural similarity of images [H, W, 3] in [0, 1]: Gaussian window, σ 1.5, 11 taps (Wang 2004)."""
    return float(
        skimage.metrics.structural_similarity(
            prediction.astype(np.float64), truth.astype(np.float64), channel_axis=-1,
            data_range=1.0, gaussian_weights=True, sigma=1.5, use_sample_covariance=False,
        )
    )  # fmt: skip
