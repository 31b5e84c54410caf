"""How well cameras fit outlines: by how much of these the hull of all of them has lost.

Seen by right cameras, a visual hull ends where each photo's object does. With wrong ones every photo carves
off what the others show (Hernández, Schmitt & Cipolla 2007, doi:10.1109/TPAMI.2007.42).
"""

from collections.abc import Callable, Iterable

import numpy as np
from scipy import ndimage

from ..capture.camera import Camera
from .box import Box
from .seen_space import cell_centres
from .visual_hull import carve, hull_box

CELLS, MARGIN = 96, 0.06
SHELL = 3
"""of the cells twice as large that any part of the hull may be in, those looked at, from outside"""
FINER = 2
"""places per pixel, along its edges, at which the hull's cells are told apart"""
FARTHEST = 5.0
"""pixels that count at most: what is thinner than a cell may not be in the hull at all"""


def outline_gap(
    cameras: list[Camera], masks: Callable[[], Iterable[np.ndarray]], region: np.ndarray
) -> float | None:
    """Pixels from outlines to the hull of all, the mean along each photo's and the median of photos; None:
    there are none, or they have nothing in common.

    With right cameras solid things that measure some sixty pixels have 0.04; finer cells tell little more.

    Args:
        masks: gives booleans [H, W] of the cameras' sizes. region: [2, 3] world box that holds the object.
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
    found = [_gap(camera, mask, points) for camera, mask in zip(cameras, masks(), strict=True)]
    gaps = [gap for gap in found if gap is not None]
    return float(np.median(gaps)) if gaps else None


def _gap(camera: Camera, mask: np.ndarray, points: np.ndarray) -> float | None:
    """Mean distance, pixels, of a mask's outline from world points [N, 3]; None: it has none."""
    outline = mask & ~ndimage.binary_erosion(mask, np.ones((3, 3)), border_value=1)
    if not outline.any():
        return None
    height, width = mask.shape
    empty = np.ones((FINER * height, FINER * width), bool)
    empty[camera.pixels_of(points, empty.shape)[0]] = False
    if empty.all():
        return FARTHEST
    distance = ndimage.distance_transform_edt(empty).reshape(height, FINER, width, FINER).min((1, 3))
    return float(np.minimum(distance[outline] / FINER, FARTHEST).mean())
