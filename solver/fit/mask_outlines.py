"""The masks of photos, and where they end."""

from collections.abc import Iterator

import numpy as np
from scipy import ndimage

from ..capture.photos import Photo
from ..capture.told import with_untold

THIN = 3
"""pixels: what is no wider than twice this is thin"""
CORNER = 12
"""pixels that may be a corner, which is no thin part"""


def masks_of(photos: list[Photo]) -> Iterator[np.ndarray]:
    """Booleans [H, W], one at a time: where each photo shows the object, or says nothing of it."""
    return (with_untold(photo.pixels[..., 3] > 0.5, photo.told) for photo in photos)


def along_outlines(mask: np.ndarray, farthest: int) -> tuple[np.ndarray, np.ndarray]:
    """Flat indices [K] of pixels up to so many steps, as a king goes, from the outline of a mask [H, W],
    either side of it, but not next to what is thin; and their steps, from 1.

    Where a frame ends no mask does, for what it shows goes on.
    """
    if mask.all() or not mask.any():
        return np.empty(0, np.int64), np.empty(0, np.int64)
    (spans,) = ndimage.find_objects(mask.astype(np.int8))
    aside = farthest + 2 * THIN
    around = tuple(slice(max(span.start - aside, 0), span.stop + aside) for span in spans)
    near = mask[around]
    steps = _steps_to(~near) + _steps_to(near)
    thin = _thin(near) | _thin(~near)
    steps[_steps_to(thin) < THIN] = farthest + 1
    rows, columns = np.nonzero(steps <= farthest)
    flat = np.ravel_multi_index((rows + around[0].start, columns + around[1].start), mask.shape)
    return flat, steps[rows, columns].astype(np.int64)


def near_outlines(mask: np.ndarray, farthest: int) -> np.ndarray:
    """[H, W] bool: the pixels of `along_outlines`."""
    found = np.zeros(mask.size, bool)
    found[along_outlines(mask, farthest)[0]] = True
    return found.reshape(mask.shape)


def _thin(mask: np.ndarray) -> np.ndarray:
    """[H, W] bool: what of a mask no octagon within it holds that is `THIN` steps from its middle to its
    sides; beyond the frame it goes on."""
    square, diamond = THIN - 1, 1
    padded = np.pad(mask, THIN, mode="edge")
    middles = _steps_to(~(_steps_to(~padded) > square), "taxicab") > diamond
    if not middles.any():
        return mask
    filled = _steps_to(_steps_to(middles) <= square, "taxicab") <= diamond
    parts, _ = ndimage.label(mask & ~filled[THIN:-THIN, THIN:-THIN], np.ones((3, 3)))
    return (np.bincount(parts.ravel()) > CORNER)[parts] & (parts > 0)


def _steps_to(mask: np.ndarray, metric: str = "chessboard") -> np.ndarray:
    """[H, W] steps, as a king goes, or along rows and columns ('taxicab'), from each pixel to the nearest
    of a mask's; if that has none, as many as fit."""
    steps = ndimage.distance_transform_cdt(~mask, metric)
    return steps if mask.any() else np.full(mask.shape, sum(mask.shape))
