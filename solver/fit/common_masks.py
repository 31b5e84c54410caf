"""What masks of one object have in common: its hull, and what each photo shows of that."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from ..capture.camera import Camera
from ..capture.told import with_untold, without_untold
from .seen_space import cell_centres
from .visual_hull import SEEN_BY, carve, hull_box

CELLS = 64
MOST_MISSING = 0.01
"""share of what photos show that may lie outside of the hull: more, and something was taken for backdrop
that is none"""
FEW = 0.06
"""share of the photos that see a cell which may take it for backdrop while the others show it"""


def fit_together(cameras: Sequence[Camera], masks: Sequence[np.ndarray], region: np.ndarray) -> bool:
    """True if all masks show something, and the hull of all of them holds it."""
    return all(mask.any() for mask in masks) and missing(cameras, masks, region) <= MOST_MISSING


def mended(
    cameras: Sequence[Camera], masks: Sequence[np.ndarray], region: np.ndarray, few: float = FEW
) -> list[np.ndarray] | None:
    """Masks [H, W] as nearly all others have it; None: they have nothing in common.

    In a photo or two, a part of the object looks like the backdrop beside it, but not from elsewhere. And a
    fold in the backdrop or the rim of a turntable stands out from it, but not where the object is.

    Args:
        few: share of the photos that may be wrong about a place.
    """
    common = _common(cameras, masks, region, CELLS, few)
    if common is None:
        return None
    # A cell further in, so that outlines stay as each photo has them.
    inner = common._replace(kept=ndimage.binary_erosion(common.kept))
    found = []
    for camera, mask in zip(cameras, masks, strict=True):
        whole, shared = (
            ndimage.grey_closing(*_centres(camera, cells.points, cells.edge, mask.shape))
            for cells in (inner, common)
        )
        whole |= mask
        parts, _ = ndimage.label(whole, np.ones((3, 3)))
        found.append(np.isin(parts, np.setdiff1d(parts[shared], 0)))
    return found


def silhouettes(
    cameras: Sequence[Camera], masks: Sequence[np.ndarray], region: np.ndarray, cells: int, few: float
) -> list[np.ndarray] | None:
    """Where photos have [H, W] what nearly all masks have in common; None: there is nothing.

    Args:
        cells: per axis of the grid by which that is told. few: see `mended`.
    """
    common = _common(cameras, masks, region, cells, few)
    if common is None:
        return None
    return [
        ndimage.maximum_filter(*_centres(camera, common.points, common.edge, mask.shape))
        for camera, mask in zip(cameras, masks, strict=True)
    ]


class _Cells(NamedTuple):
    """Some cells of a grid."""

    centres: np.ndarray  # [K·K·K, 3] world, of all
    kept: np.ndarray  # [K, K, K] bool: which
    edge: float  # of a cell, world units

    @property
    def points(self) -> np.ndarray:
        """[N, 3] centres of those that are kept."""
        return self.centres[self.kept.ravel()]


def _common(
    cameras: Sequence[Camera], masks: Sequence[np.ndarray], region: np.ndarray, cells: int, few: float
) -> _Cells | None:
    """The cells that no more than `few` of the photos that see them take for backdrop; None: masks have
    nothing in common."""
    box = hull_box(list(cameras), lambda: _maybe(cameras, masks), region, CELLS)
    if box is None:
        return None
    points = cell_centres(box, cells)
    alive = np.arange(len(points))
    seen, against = np.zeros((2, len(points)))
    for camera, mask in zip(cameras, masks, strict=True):
        at, inside, _ = camera.pixels_of(points[alive], mask.shape)
        seen[alive[inside]] += 1
        against[alive[inside]] += ~mask[at]
        # No other photo can save the rest.
        alive = alive[against[alive] <= few * len(masks)]
    kept = (against <= few * seen) & (seen >= SEEN_BY * len(masks))
    return _Cells(points, kept.reshape((cells,) * 3), float((box[1] - box[0]).max()) / cells)


def missing(cameras: Sequence[Camera], masks: Sequence[np.ndarray], region: np.ndarray) -> float:
    """Share of what masks show that the visual hull of all of them does not cover, over all photos."""
    listed = list(cameras)
    box = hull_box(listed, lambda: _maybe(listed, masks), region, CELLS)
    if box is None:
        return 1.0
    hull = carve(listed, _maybe(listed, masks), box, CELLS, whole_cells=True)
    cells = cell_centres(box, CELLS)[hull.ravel()]
    edge = float((box[1] - box[0]).max()) / CELLS
    lost = all_shown = 0
    for camera, mask in zip(listed, masks, strict=True):
        centres, width = _centres(camera, cells, edge, mask.shape)
        if not centres.any():
            return 1.0
        covered = ndimage.maximum_filter(centres, width)
        mask = without_untold(mask, camera.told_at(mask.shape))
        lost += int((mask & ~covered).sum())
        all_shown += int(mask.sum())
    return lost / max(all_shown, 1)


def _maybe(cameras: Sequence[Camera], masks: Sequence[np.ndarray]) -> Iterator[np.ndarray]:
    """Masks [H, W] with what photos say nothing of: the object may be there."""
    for camera, mask in zip(cameras, masks, strict=True):
        yield with_untold(mask, camera.told_at(mask.shape))


def _centres(
    camera: Camera, cells: np.ndarray, edge: float, shape: tuple[int, int]
) -> tuple[np.ndarray, int]:
    """Pixels [H, W] of a photo of this shape where cells have their centres [N, 3]; and an odd number of
    pixels, wider than gaps between them."""
    centres = np.zeros(shape, bool)
    # Where a photo says nothing, too: the cells are there.
    at, inside, depths = replace(camera, told=None).pixels_of(cells, shape)
    if not inside.any():
        return centres, 1
    centres[at] = True
    # A cell is as wide as its neighbours are apart.
    scale = max(camera.fx, camera.fy) * shape[1] / camera.width
    reach = edge * scale / np.median(camera.depths_of_scale(cells[inside], depths))
    return centres, 2 * int(np.ceil(reach)) + 1
