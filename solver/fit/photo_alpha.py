"""Alpha for a photo of which it is known what is the object, and what is behind it."""

from dataclasses import replace

import numpy as np

from ..capture.backdrop import coverage_before
from ..capture.photos import Photo, linear_to_srgb, srgb_to_linear
from ..capture.told import filled


def srgb_of(photo: Photo) -> np.ndarray:
    """Colours [H, W, 3] sRGB of a photo without alpha; those of the nearest pixel that says something where
    it says nothing, so that a backdrop goes on behind a hand, and to the frame's edge around a fisheye."""
    return filled(linear_to_srgb(photo.pixels[..., :3]), photo.told)


def levels_of(photo: Photo) -> np.ndarray:
    """[H, W, 3] float32 sRGB, clipped."""
    return srgb_of(photo).clip(0, 1).astype(np.float32)


def with_alpha(photo: Photo, shown: np.ndarray, behind: float | np.ndarray) -> Photo:
    """A photo of which the object is what is `shown` [H, W], and the rest the backdrop.

    Where the photo says nothing, it is as next to that.

    Args:
        behind: the backdrop's sRGB level, or its colours [H, W, 3].
    """
    colour = srgb_of(photo)
    if photo.told is not None:
        shown = filled(shown[..., None], photo.told)[..., 0]
    alpha = coverage_before(colour, shown, behind)[..., None]
    straight = (colour - (1 - alpha) * behind) / np.maximum(alpha, 1e-3)
    mixed = srgb_to_linear(np.clip(straight, 0, np.inf if photo.is_hdr else 1)) * alpha
    partly = (alpha > 0) & (alpha < 1)
    linear = np.where(partly, mixed, photo.pixels[..., :3] * (alpha > 0))
    pixels = np.concatenate([linear, alpha], axis=-1).astype(np.float32)
    return replace(photo, pixels=pixels, has_alpha=True)
