"""Photos of an object before plain white or black get alpha: the fit then begins with its hull."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.ndimage

from ..capture.backdrop import LEVELS, backdrop_of, border_of, coverage_before, object_before
from ..capture.camera import Camera
from ..capture.capture import Capture
from ..capture.photos import Photo, linear_to_srgb, srgb_to_linear
from .seen_space import cell_centres
from .visual_hull import carve, hull_box

CELLS = 64
MOST_MISSING = 0.01
"""share of what photos show that may lie outside of the hull: more, and something was taken for backdrop
that is none"""


def cut_out(capture: Capture, photos: list[Photo], region: np.ndarray | None = None) -> list[Photo]:
    """Photos with the object's coverage as alpha, if none has alpha and all are before one plain backdrop.

    A part of the object that is as white or black as what is behind it would be lost, and with it all that
    lies behind it as seen from there. Then the hull no longer holds what other photos show; photos of which
    that is so are returned as they are.

    Args:
        region: [2, 3] world box of the object; None: the capture's.
    """
    backdrop = backdrop_behind(photos)
    if backdrop is None:
        return photos
    shown = [object_before(_srgb(photo), backdrop) for photo in photos]
    box = capture.region if region is None else region
    if not fit_together(capture.cameras, shown, box):
        return photos
    return [_with_alpha(photo, mask, backdrop) for photo, mask in zip(photos, shown, strict=True)]


def backdrop_behind(photos: list[Photo]) -> str | None:
    """'white' or 'black', if that is plainly behind the object in photos without alpha; else None."""
    if any(photo.has_alpha for photo in photos):
        return None
    return backdrop_of([linear_to_srgb(border_of(photo.pixels[..., :3])) for photo in photos])


def fit_together(cameras: tuple[Camera, ...], masks: list[np.ndarray], region: np.ndarray) -> bool:
    """True if all masks show something, and the hull of all of them holds it."""
    return all(mask.any() for mask in masks) and missing(cameras, masks, region) <= MOST_MISSING


def missing(cameras: tuple[Camera, ...], masks: list[np.ndarray], region: np.ndarray) -> float:
    """Share of what masks show that the visual hull of all of them does not cover, over all photos."""
    listed = list(cameras)
    box = hull_box(listed, lambda: masks, region, CELLS)
    if box is None:
        return 1.0
    hull = carve(listed, masks, box, CELLS, whole_cells=True)
    cells = cell_centres(box, CELLS)[hull.ravel()]
    edge = float((box[1] - box[0]).max()) / CELLS
    lost = all_shown = 0
    for camera, mask in zip(listed, masks, strict=True):
        height, width = mask.shape
        pixel, depth = camera.project(cells)
        pixel = np.nan_to_num(pixel, nan=-1.0) * (width / camera.width, height / camera.height)
        inside = (depth > 0) & (pixel >= 0).all(1) & (pixel < (width, height)).all(1)
        if not inside.any():
            return 1.0
        column, row = pixel[inside].astype(int).T
        covered = np.zeros(mask.shape, bool)
        covered[row, column] = True
        # A cell is as wide as its neighbours are apart.
        reach = edge * max(camera.fx, camera.fy) * width / camera.width / np.median(depth[inside])
        covered = scipy.ndimage.maximum_filter(covered, 2 * int(np.ceil(reach)) + 1)
        lost += int((mask & ~covered).sum())
        all_shown += int(mask.sum())
    return lost / max(all_shown, 1)


def _srgb(photo: Photo) -> np.ndarray:
    return linear_to_srgb(photo.pixels[..., :3])


def _with_alpha(photo: Photo, shown: np.ndarray, backdrop: str) -> Photo:
    """A photo of which the object is what is `shown` [H, W], and the rest the backdrop."""
    colour = _srgb(photo)
    alpha = coverage_before(colour, shown, backdrop)[..., None]
    straight = (colour - (1 - alpha) * LEVELS[backdrop]) / np.maximum(alpha, 1e-3)
    mixed = srgb_to_linear(np.clip(straight, 0, np.inf if photo.is_hdr else 1)) * alpha
    partly = (alpha > 0) & (alpha < 1)
    linear = np.where(partly, mixed, photo.pixels[..., :3] * (alpha > 0))
    pixels = np.concatenate([linear, alpha], axis=-1).astype(np.float32)
    return replace(photo, pixels=pixels, has_alpha=True, backdrop=backdrop)
