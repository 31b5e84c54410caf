"""How well cameras fit outlines: by how much of these the hull of all of them has lost.

Seen by right cameras, a visual hull ends where each photo's object does. With wrong ones every photo carves
off what the others show (Hernández, Schmitt & Cipolla 2007, doi:10.1109/TPAMI.2007.42).
"""

from collections.abc import Callable, Iterable

import numpy as np
from scipy import ndimage

from ..capture.camera import Camera
from ..capture.photos import Photo, resized
from .box import Box
from .seen_space import cell_centres
from .visual_hull import carve, hull_box

OBJECT_PIXELS = 64
"""that the object measures in photos made smaller for this: from 100 pixels on it brings nothing"""
CELLS, MARGIN = 96, 0.06
SHELL = 3
"""of the cells twice as large that any part of the hull may be in, those looked at, from outside"""
FINER = 2
"""places per pixel, along its edges, at which the hull's cells are told apart"""
FARTHEST = 5.0
"""pixels that count at most: what is thinner than a cell may not be in the hull at all"""


def made_small(photos: list[Photo]) -> tuple[list[Photo], float]:
    """Photos in which the object measures `OBJECT_PIXELS`, and how large they are of what they were."""
    longest = []
    for photo in photos:
        rows, columns = np.nonzero(photo.cover > 0.5)
        longest.append(max(np.ptp(rows), np.ptp(columns)) + 1 if len(rows) else 0)
    factor = min(1.0, OBJECT_PIXELS / max(float(np.median(longest)), 1.0))
    small = []
    for photo in photos:
        width, height = (max(2, round(factor * side)) for side in photo.pixels.shape[1::-1])
        plain = Photo(photo.pixels, photo.has_alpha, photo.is_hdr, told=photo.told)
        small.append(resized(plain, width, height))
    return small, factor


def outline_gap(
    cameras: list[Camera], masks: Callable[[], Iterable[np.ndarray]], region: np.ndarray,
    counted: Callable[[], Iterable[np.ndarray]] | None = None,
) -> float | None:  # fmt: skip
    """Pixels from outlines to the hull of all, the mean along each photo's and the median of photos; None:
    there are none, or they have nothing in common.

    With right cameras solid things that measure some sixty pixels have 0.04; finer cells tell little more.

    Args:
        masks: gives booleans [H, W] of the cameras' sizes. region: [2, 3] world box that holds the object.
        counted: gives booleans [H, W], where outlines count; None: everywhere.
    """
    tight = hull_box(cameras, masks, region, CELLS // 2)
    if tight is None:
        return None
    box = Box.around(tight)
    cube = Box(box.centre, (1 + MARGIN) * box.half_size).world
    coarse = carve(cameras, masks(), cube, CELLS // 2, whole_cells=True)
    shell = coarse & ~ndimage.binary_erosion(coarse, iterations=SHELL)
    surface = carve(cameras, masks(), cube, CELLS, within=shell.repeat(2, 0).repeat(2, 1).repeat(2, 2))
    points = cell_centres(cube, CELLS)[surface.ravel()]
    where = [None] * len(cameras) if counted is None else counted()
    found = [_gap(*each, points) for each in zip(cameras, masks(), where, strict=True)]
    gaps = [gap for gap in found if gap is not None]
    return float(np.median(gaps)) if gaps else None


def _gap(camera: Camera, mask: np.ndarray, counted: np.ndarray | None, points: np.ndarray) -> float | None:
    """Mean distance, pixels, of a mask's outline from world points [N, 3]; None: it has none."""
    outline = mask & ~ndimage.binary_erosion(mask, np.ones((3, 3)), border_value=1)
    if counted is not None:
        outline &= counted
    if not outline.any():
        return None
    height, width = mask.shape
    empty = np.ones((FINER * height, FINER * width), bool)
    empty[camera.pixels_of(points, empty.shape)[0]] = False
    if empty.all():
        return FARTHEST
    distance = ndimage.distance_transform_edt(empty).reshape(height, FINER, width, FINER).min((1, 3))
    return float(np.minimum(distance[outline] / FINER, FARTHEST).mean())
