"""Photos before what is far away get alpha: it looks the same in all photos that look in one direction."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from ..capture.backdrop import border_share, from_the_edge, without_dust
from ..capture.camera import Camera
from ..capture.capture import Capture
from ..capture.panorama import Behind, Comparison, Panorama, panorama_of
from ..capture.photos import Photo, resized
from ..capture.told import filled, with_untold, without_untold
from ..threads import thread_pool
from .common_masks import CELLS, fit_together, mended, silhouettes
from .photo_alpha import levels_of, with_alpha

FEWER = 0.02
"""share of the photos that may be wrong about a place before surroundings that are far: it is chance if one
shows there just what is behind"""
GAP = 5
"""pixels that a gap is wide, at least, of which a single photo is believed"""
MOST_STRAY = 0.03
"""of the object's pixels, that stand out elsewhere: more, and parts of the object look like what is behind
them, so that its hull lacks them, or that is not far"""
MOST_AT_EDGE = 0.5
"""of a photo's edge that the object takes, in the median photo: more, and it is the ground, of which some
is as even as what is far"""
TOGETHER = 10
"""photos of which the hull tells where the object is"""
FINE_CELLS = 96
"""per axis of the hull that tells what photos cannot, before surroundings that are far"""
UNSURE = 0.03
"""of a photo's shorter side, within which what no other photo shows may or may not be the object"""
COMPARING, MAPPED = 0.25, 0.5
"""shares of the time for cutting out that comparing photos takes, and all up to the panorama"""
COMPARED = 40_000
"""pixels of photos that are compared with each other"""


class BeforeFar(NamedTuple):
    """Photos that were cut out before surroundings that are far away, and those."""

    photos: list[Photo]
    panorama: Panorama  # sRGB, clipped


def cut_out_before_far(
    capture: Capture, photos: list[Photo], progress: Callable[[float], None] = lambda done: None
) -> BeforeFar | None:
    """As `cut_out`, before surroundings so far away that all photos show the same in one direction.

    What photos agree about is behind the object. What they do not agree about is the object, or the object
    is in their way; its hull tells which.

    Returns:
        None where photos have alpha, surroundings are not far, or what stands out does not fit together.
    """
    if any(photo.has_alpha for photo in photos):
        return None
    cameras, box = capture.cameras, capture.region
    small = [camera.no_larger(COMPARED) for camera in cameras]
    compared = Comparison(small, [
        levels_of(resized(photo, smaller.width, smaller.height))
        for photo, smaller in zip(photos, small, strict=True)
    ])  # fmt: skip
    if not compared.is_far():
        return None
    with thread_pool() as pool:
        agreements = []
        for found in pool.map(compared.agreement, range(len(photos))):
            agreements.append(found)
            progress(COMPARING * len(agreements) / len(photos))
    maybe = [
        ~_wide_from_the_edge(with_untold(found.is_far, camera.told_at(found.seen.shape)))
        for camera, found in zip(small, agreements, strict=True)
    ]
    near = silhouettes(small, maybe, box, CELLS, FEWER)
    if near is None:
        return None
    maybe = [
        at_size(ndimage.binary_dilation(mask & around, np.ones((3, 3))), photo.pixels.shape[:2])
        for mask, around, photo in zip(maybe, near, photos, strict=True)
    ]
    panorama = panorama_of(cameras, map(levels_of, photos), maybe)
    progress(MAPPED)
    found = before_panorama(cameras, photos, panorama, box)
    return None if found is None else BeforeFar(found, panorama)


def before_panorama(
    cameras: Sequence[Camera], photos: list[Photo], panorama: Panorama, region: np.ndarray
) -> list[Photo] | None:
    """Photos with alpha where they show something before a panorama; None: that does not fit together.

    Args:
        region: [2, 3] world box of the object.
    """
    plain, known = [], []
    for camera, photo in zip(cameras, photos, strict=True):
        behind = _behind(camera, photo, panorama)
        plain.append(with_untold(behind.is_seen_in(levels_of(photo)), photo.told))
        known.append(without_untold(behind.known, photo.told))
    shown = [~ndimage.binary_opening(mask, np.ones((2, 2))) for mask in plain]
    # What no other photo shows is told by where the object is.
    near = silhouettes(cameras, shown, region, FINE_CELLS, FEWER)
    if near is None:
        return None
    if _stray([mask & told for mask, told in zip(shown, known, strict=True)], near) > MOST_STRAY:
        return None
    shown = [mask & around for mask, around in zip(shown, near, strict=True)]
    shown = mended(cameras, shown, region, FEWER)
    if shown is not None:
        # A gap that hardly any other photo shows is one all the same.
        wide = [_wide_from_the_edge(mask, GAP) for mask in plain]
        shown = [mask & ~gap for mask, gap in zip(shown, wide, strict=True)]
    if shown is None or np.median([border_share(mask) for mask in shown]) > MOST_AT_EDGE:
        return None
    if not fit_together(cameras, shown, region):
        return None
    # Looked up once more: of all photos together, that is more than may be kept.
    return [
        _before(photo, mask, _behind(camera, photo, panorama))
        for camera, photo, mask in zip(cameras, photos, shown, strict=True)
    ]


def _stray(sure: list[np.ndarray], near: list[np.ndarray]) -> float:
    """How much stands out for `sure` [H, W] where the object is not `near`, as a share of the object."""
    stray = sum(
        int(ndimage.binary_opening(mask & ~around, np.ones((3, 3))).sum())
        for mask, around in zip(sure, near, strict=True)
    )
    return stray / max(sum(int(mask.sum()) for mask in near), 1)


def few_before_panorama(
    cameras: Sequence[Camera], photos: list[Photo], panorama: Panorama, region: np.ndarray
) -> list[Photo]:
    """As `before_panorama`; each by itself, where photos are too few to fit together."""
    found = None
    if len(photos) >= TOGETHER:
        found = before_panorama(cameras, photos, panorama, region)
    if found is not None:
        return found
    cut = []
    for camera, photo in zip(cameras, photos, strict=True):
        behind = _behind(camera, photo, panorama)
        shown = without_dust(behind.known & ~behind.is_seen_in(levels_of(photo)))
        shown = ndimage.binary_fill_holes(shown)
        cut.append(_before(photo, shown, behind))
    return cut


def _behind(camera: Camera, photo: Photo, panorama: Panorama) -> Behind:
    return panorama.behind(camera, photo.pixels.shape[:2])


def _before(photo: Photo, shown: np.ndarray, behind: Behind) -> Photo:
    """A photo of which the object is what is `shown` [H, W], before what is far behind it."""
    colour = filled(behind.colour, behind.known)
    depth = ndimage.distance_transform_edt(shown)
    unsure = shown & ~behind.known & (depth <= UNSURE * min(shown.shape))
    return replace(with_alpha(photo, shown, colour), behind=colour.astype(np.float16), unsure=unsure)


def _wide_from_the_edge(plain: np.ndarray, least: int = 3) -> np.ndarray:
    """What of a mask [H, W] is connected with the photo's edge, and everywhere as many pixels wide."""
    return from_the_edge(ndimage.binary_opening(plain, np.ones((least, least))))


def at_size(mask: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """A mask at another size (rows, columns)."""
    row, column = (
        ((np.arange(size) + 0.5) * own / size).astype(int)
        for size, own in zip(shape, mask.shape, strict=True)
    )
    return mask[row[:, None], column]
