"""The sRGB transfer function and pixels over a background."""

import torch
from torch import Tensor


def linear_to_srgb(linear: Tensor) -> Tensor:
    """sRGB encoding (IEC 61966-2-1), continued above 1 with its own slope, below 0 linearly."""
    curve = 1.055 * linear.clamp(min=0.0031308) ** (1 / 2.4) - 0.055
    return torch.where(linear <= 0.0031308, 12.92 * linear, curve)


def srgb_to_linear(encoded: Tensor) -> Tensor:
    """Inverse of `linear_to_srgb`."""
    curve = ((encoded.clamp(min=0.04045) + 0.055) / 1.055) ** 2.4
    return torch.where(encoded <= 0.04045, encoded / 12.92, curve)


def over_background(linear: Tensor, opacity: Tensor, background: Tensor | float) -> Tensor:
    """sRGB pixels [N, 3] of premultiplied linear radiance [N, 3] over an sRGB background.

    As photos with alpha are composited: sRGB(C/α)·α + (1 − α)·background.
    """
    alpha = opacity.clamp(0, 1)[:, None]
    straight = linear / alpha.clamp(min=1e-3)
    return linear_to_srgb(straight) * alpha + (1 - alpha) * background
