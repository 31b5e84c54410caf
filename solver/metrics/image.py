"""Image metrics. Images are sRGB [H, W, 3] in [0, 1], over white unless said otherwise.

`told` [H, W] bool is where the truth says something (`Photo.told`), None: everywhere. Metrics that look at
a pixel with what is around it take the prediction for true elsewhere (`true_where_told`).
"""

from functools import lru_cache

import numpy as np
import skimage.metrics
import torch

SSIM_MARGIN = 5
"""pixels along the edges around which windows of 11 taps reach out of a picture"""
MS_SSIM_MIN_SIDE = 161
"""five scales with an 11-tap window need this many pixels"""


def true_where_told(prediction: np.ndarray, truth: np.ndarray, told: np.ndarray | None) -> np.ndarray:
    """The truth, and the prediction where it says nothing, so that neither is better or worse for that."""
    return truth if told is None else np.where(told[..., None], truth, prediction)


def psnr(prediction: np.ndarray, truth: np.ndarray, told: np.ndarray | None = None) -> float:
    """Peak signal-to-noise ratio in dB of images in [0, 1], over the pixels that are told."""
    if told is not None:
        prediction, truth = prediction[told], truth[told]
    error = np.mean((prediction.astype(np.float64) - truth.astype(np.float64)) ** 2)
    return float("inf") if error == 0 else float(-10 * np.log10(error))


def ssim(prediction: np.ndarray, truth: np.ndarray, told: np.ndarray | None = None) -> float:
    """Structural similarity: Gaussian window, σ 1.5, 11 taps (Wang et al. 2004); the mean of the windows
    around pixels that are told."""
    truth = true_where_told(prediction, truth, told)
    found = skimage.metrics.structural_similarity(
        prediction.astype(np.float64), truth.astype(np.float64), channel_axis=-1, data_range=1.0,
        gaussian_weights=True, sigma=1.5, use_sample_covariance=False, full=told is not None,
    )  # fmt: skip
    if told is None:
        return float(found)
    # As the mean of all: of windows that lie within the picture.
    inner = np.s_[SSIM_MARGIN:-SSIM_MARGIN, SSIM_MARGIN:-SSIM_MARGIN]
    kept = found[1][inner][told[inner]]
    return float(kept.mean() if kept.size else found[1][told].mean())


def ms_ssim(prediction: np.ndarray, truth: np.ndarray) -> float | None:
    """Multi-scale SSIM (Wang et al. 2003); None for images that are too small for five scales."""
    import pytorch_msssim  # only evaluations need it, not every reconstruction

    if min(prediction.shape[:2]) < MS_SSIM_MIN_SIDE:
        return None
    pair = [torch.from_numpy(_channels_first(image)).double() for image in (prediction, truth)]
    return float(pytorch_msssim.ms_ssim(*pair, data_range=1.0))


def flip(prediction: np.ndarray, truth: np.ndarray, told: np.ndarray | None = None) -> float:
    """Mean LDR-FLIP at 67 pixels per degree (Andersson et al. 2020, doi:10.1145/3406183) of the pixels that
    are told; 0 is best."""
    import flip_evaluator

    truth = true_where_told(prediction, truth, told)
    images = [np.ascontiguousarray(i, dtype=np.float32) for i in (truth, prediction)]
    errors, mean, *_ = flip_evaluator.evaluate(*images, "LDR", applyMagma=False)
    return float(mean if told is None else errors.reshape(told.shape)[told].mean())


def lpips(prediction: np.ndarray, truth: np.ndarray) -> float | None:
    """LPIPS v0.1 with AlexNet (Zhang et al. 2018), as in the paper's tables.

    None where the packages lpips and torchvision or the network's weights are not installed;
    nothing is downloaded.
    """
    network = _lpips_network()
    if network is None:
        return None
    pair = [torch.from_numpy(_channels_first(image)).float() * 2 - 1 for image in (prediction, truth)]
    with torch.no_grad():
        return float(network(*pair))


@lru_cache(maxsize=1)
def _lpips_network():
    try:
        import lpips as package
        from torchvision.models import AlexNet_Weights
    except (ImportError, RuntimeError):
        # torchvision raises RuntimeError where it does not fit the installed torch.
        return None
    weights = f"{torch.hub.get_dir()}/checkpoints/{AlexNet_Weights.DEFAULT.url.split('/')[-1]}"
    try:
        torch.load(weights, map_location="cpu", weights_only=True)
    except (OSError, RuntimeError):
        return None
    return package.LPIPS(net="alex", verbose=False)


def _channels_first(image: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(image.transpose(2, 0, 1)[None])
