"""Photos of an object on a table, a floor, a lawn get alpha: the fit then begins with its hull."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import ndimage
from skimage.color import rgb2lab

from ..capture.camera import Camera
from ..capture.capture import Capture, cube_seen_by
from ..capture.photos import Photo, resized
from ..capture.told import filled
from ..capture.upright import up_of
from ..light.floor import Floor
from .before_far import at_size
from .common_masks import fit_together
from .photo_alpha import levels_of, srgb_of, with_alpha
from .standing import Outline, Picture, Standing
from .standing_search import find_standing
from .support import Support, support_of

COMPARED, OUTLINED = 60_000, 240_000
"""pixels of photos by which it is found where the object is, and where it ends"""
FINDING = 0.7
"""share of the time that the former takes"""
MIXED = 2
"""pixels beside the object that may have some of its colour"""


class OnSupport(NamedTuple):
    """What stands on a support, where each photo shows it, and a world box [2, 3] around it."""

    standing: Standing
    outlines: list[Outline]
    box: np.ndarray


def find_on_support(
    capture: Capture, photos: list[Photo], region: np.ndarray | None = None,
    progress: Callable[[float], None] = lambda done: None,
) -> OnSupport | None:  # fmt: skip
    """Where photos show what stands on a level support.

    Args:
        capture: with sparse points. region: [2, 3] world box of the object; None: the capture's.

    Returns:
        None where photos have alpha, there is no support, or what stands on it does not fit together.
    """
    if any(photo.has_alpha for photo in photos):
        return None
    box = _searched(capture, region)
    support = support_below(capture, region)
    if support is None:
        return None
    pictures = [
        picture_of(camera.no_larger(COMPARED), photo)
        for camera, photo in zip(capture.cameras, photos, strict=True)
    ]
    standing = find_standing(support, pictures, box, lambda done: progress(FINDING * done))
    if standing is None:
        return None
    outlines = []
    for camera, photo in zip(capture.cameras, photos, strict=True):
        outlines.append(_outline(standing, camera, photo))
        progress(FINDING + (1 - FINDING) * len(outlines) / len(photos))
    small = [at_size(o.shown, p.colour.shape[:2]) for o, p in zip(outlines, pictures, strict=True)]
    if not fit_together([p.camera for p in pictures], small, box):
        return None
    return OnSupport(standing, outlines, box)


def support_below(capture: Capture, region: np.ndarray | None = None) -> Support | None:
    """What the object stands on, by the capture's sparse points; None if they tell of nothing.

    Args:
        region: [2, 3] world box of the object; None: the capture's.
    """
    if capture.has_few_points:
        return None
    return support_of(capture.points, _searched(capture, region), up_of(capture))


def _searched(capture: Capture, region: np.ndarray | None) -> np.ndarray:
    """World box [2, 3] in which the object is looked for."""
    # Points draw the capture's region together, and shiny things have none.
    return cube_seen_by(list(capture.cameras)) if region is None else region


def floor_below(standing: Standing) -> Floor:
    """The support as a part of the object's light, which is seen from the object's middle."""
    support, surface = standing.ground.support, standing.surface.centres
    middle = (surface.min(0) + surface.max(0)) / 2
    return Floor(tuple(support.normal.tolist()), support.height, tuple(middle.tolist()))


def before_support(photo: Photo, outline: Outline) -> Photo:
    """A photo with alpha; what is behind the object's outline is as what is beside it."""
    beside = ~ndimage.binary_dilation(outline.shown, np.ones((3, 3)), MIXED)
    colour = filled(srgb_of(photo), beside)
    return replace(
        with_alpha(photo, outline.shown, colour), behind=colour.astype(np.float16), unsure=outline.unsure
    )


def few_on_support(cameras: Sequence[Camera], photos: list[Photo], standing: Standing) -> list[Photo]:
    """Other photos of what is standing there, with alpha."""
    return [
        before_support(photo, _outline(standing, camera, photo))
        for camera, photo in zip(cameras, photos, strict=True)
    ]


def picture_of(camera: Camera, photo: Photo) -> Picture:
    """A photo at the size of its camera, which may have been made smaller."""
    return Picture(camera, rgb2lab(levels_of(resized(photo, camera.width, camera.height))))


def _outline(standing: Standing, camera: Camera, photo: Photo) -> Outline:
    found = standing.outline(picture_of(camera.no_larger(OUTLINED), photo))
    return Outline(*(at_size(mask, photo.pixels.shape[:2]) for mask in found))
