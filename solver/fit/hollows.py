"""Hollows that no silhouette shows: the inside of a bowl, a mug, a shoe. The visual hull has a lid on them.

Two things tell a lid from a surface. Each ray along a photo's silhouette touches the object somewhere, so
where such rays pass through little of the hull, they hold its surface in place; a lid they only pass along.
And what lies below a lid moves beneath it from photo to photo, so photos disagree about its colours. What
nothing holds and photos disagree about is carved, until they agree: space carving (Kutulakos and Seitz
2000, doi:10.1023/A:1008191222954) where silhouettes say nothing. A flat gloss looks different from photo to
photo, too, but in one colour all over. What stereo tells of the air goes first; it needs patterns.
"""

import math
import warnings
from typing import NamedTuple

import numpy as np
import skimage.measure
from scipy import ndimage

from ..capture.camera import Camera
from ..capture.photos import Photo
from .held_cells import held_by_silhouettes
from .seen_space import cell_centres
from .stereo import AIR, WHOLE, air_seen, parts_of, reduced_photo

FINEST = 64
"""cells per axis on which hollows are looked for, at most"""
MOST_PHOTOS = 80
"""evenly taken from all, that are looked at"""
LEAST_LOOSE = 0.03
"""share of the hull's surface that nothing holds, below which there is nothing to look for"""
SEEN_BY = 3
"""photos that must see a cell to disagree about it"""
AGREEING = 0.7
"""share of the photos that see a surface's cell that agree about its colour; others see highlights"""
TOLERANCE, SHINY = (0.035, 0.15), 1.5
"""range of differences of colour, sRGB, up to which photos agree; within it as many times as much as they
differ where the surface is held, which is more for shiny objects"""
FEWEST = 20
"""cells that a pass has to carve for another one to follow"""
BETTER, BETTER_DEEP_DOWN = 0.4, 0.3
"""share of the lid's disagreement that may be left below it, and at the best floor of all that lie deeper,
which chance finds more easily. Carving a mirror finds nothing of the kind"""
SHEEN = 0.35
"""share of the lid's disagreement that may be left at least when each photo is taken to show all of it in
another colour: so does a flat gloss, but not what lies in a hollow"""
SMALLEST = 0.01
"""share of the hull that a hollow has at least; photos disagree about a few cells for many reasons"""
NEARLY = 1.1
"""times the least disagreement about a floor that the first one may have that is carved down to"""
OPENED = 0.005
"""share of what masks show that may be seen through: beyond it, carving has gone through a wall"""


def carve_hollows(
    cameras: list[Camera], photos: list[Photo], hull: np.ndarray, box: np.ndarray
) -> np.ndarray:
    """The visual hull without the lids on its hollows.

    Args:
        photos: with alpha.
        hull: [K, K, K] bool of cells of the world box [2, 3].

    Returns:
        [K, K, K] bool; the hull itself, if silhouettes hold all of it.
    """
    every = math.ceil(len(cameras) / MOST_PHOTOS)
    cameras, photos = cameras[::every], photos[::every]
    finer = max(1, hull.shape[0] // FINEST)
    if hull.shape[0] % finer or not hull.any():
        return hull
    held_exactly = held_by_silhouettes(cameras, photos, hull, box)
    coarse, held = _coarser(hull, finer), _coarser(held_exactly, finer)
    surface = _surface(coarse)
    if (surface & ~held).sum() < LEAST_LOOSE * surface.sum():
        return hull
    air = air_seen(cameras, photos, coarse, held, box)
    if air.any():
        hull = hull & (held_exactly | (_finer(air, coarse, finer) <= AIR))
        coarse = _coarser(hull, finer)
    carving = Carving(cameras, photos, coarse, box, held)
    floors = carving.until_photos_agree(carving.lids)
    carved = carving.believed(floors, BETTER)
    if carved.any():
        carved = coarse & ~carving.deepened(coarse & ~carved)
    elif (doubted := carving.of_size(coarse & ~floors.kept)).any():
        # In a hollow of one colour the first floor may lie far above what is at its bottom.
        deepest = carving.look_at(carving.deepened(coarse & ~doubted))
        carved = carving.believed(deepest, BETTER_DEEP_DOWN)
    return hull & ~carved.repeat(finer, 0).repeat(finer, 1).repeat(finer, 2)


class _Surface(NamedTuple):
    """What photos say of the surface of some of a hull's cells.

    Attributes:
        kept: [K, K, K] bool, the cells.
        cells: [N] numbers of those at the surface.
        spread: [N] how far from their median most photos' colours are; NaN: too few see the cell.
        times: [N] how many photos see it.
        opened: share of the masks where nothing is seen.
    """

    kept: np.ndarray
    cells: np.ndarray
    spread: np.ndarray
    times: np.ndarray
    opened: float


class Carving:
    """Cells of a hull, and what each photo shows where they are."""

    def __init__(
        self, cameras: list[Camera], photos: list[Photo], hull: np.ndarray, box: np.ndarray,
        held: np.ndarray,
    ):  # fmt: skip
        self.hull, self.held = hull, held
        self.edge = float((box[1] - box[0]).max()) / hull.shape[0]
        self.index = np.flatnonzero(hull)
        self.number = np.zeros(hull.size, dtype=np.int64)
        self.number[self.index] = np.arange(len(self.index))
        points = cell_centres(box, hull.shape[0])[self.index]
        self.colours, self.depths, self.pixels, self.masks = [], [], [], []
        for camera, photo in zip(cameras, photos, strict=True):
            self._add(camera, photo, points)
        self.lids = self.look_at(hull)
        usual = SHINY * _median(self.lids.spread[self._among(held, self.lids)])
        self.tolerance = np.clip(np.nan_to_num(usual, nan=TOLERANCE[1]), *TOLERANCE)

    def _add(self, camera: Camera, photo: Photo, points: np.ndarray) -> None:
        pixel, depth = camera.project(points)
        depths = camera.depths_of_scale(points, depth)
        per_cell = self.edge * max(camera.fx, camera.fy) / np.median(depths)
        smaller = max(1, round(per_cell))
        height, width = (math.ceil(n / smaller) for n in photo.pixels.shape[:2])
        colours, alpha = reduced_photo(photo, smaller)
        column, row = np.floor(np.nan_to_num(pixel, nan=-1) / smaller).astype(np.int64).T
        outside = (depth <= 0) | (column < 0) | (row < 0) | (column >= width) | (row >= height)
        shown = alpha > 0.99
        if photo.told is not None:
            told = skimage.measure.block_reduce(photo.told, smaller, np.min, cval=True)
            shown &= told
            outside |= ~told[row.clip(0, height - 1), column.clip(0, width - 1)]
        place = np.where(outside, 0, row * width + column)
        self.colours.append(colours.reshape(-1, 3)[place].astype(np.float32))
        self.depths.append(np.where(outside, np.inf, depth).astype(np.float32))
        self.pixels.append(place)
        # A pixel or two within the outline, where a hull of cells covers all.
        self.masks.append(ndimage.binary_erosion(shown, iterations=2))

    def look_at(self, kept: np.ndarray) -> _Surface:
        """What photos say of the surface of the cells `kept` [K, K, K]."""
        cells = self.number[np.flatnonzero(_surface(kept))]
        seen, opened = self.seen_from(cells)
        return _Surface(kept, cells, self._spread(cells, seen), seen.sum(0), opened)

    def until_photos_agree(self, surface: _Surface) -> _Surface:
        """What is left when photos agree about all that they see and that is not held."""
        before = surface
        while surface.opened <= OPENED:
            wrong = (surface.spread > self.tolerance) & ~self._among(self.held, surface)
            if wrong.sum() < FEWEST:
                return surface
            kept = surface.kept & ~self._grid(surface.cells[wrong])
            before, surface = surface, self.look_at(kept)
        return before

    def of_size(self, cells: np.ndarray) -> np.ndarray:
        """Those of `cells` [K, K, K] in parts that are large enough for a hollow."""
        return np.any([np.zeros_like(cells), *self._parts(cells)], axis=0)

    def _parts(self, cells: np.ndarray) -> list[np.ndarray]:
        return parts_of(cells, SMALLEST * self.hull.sum())

    def believed(self, floors: _Surface, better: float) -> np.ndarray:
        """Cells [K, K, K] that were carved where photos agree much better about what came to light.

        Args:
            better: share of the lid's disagreement that may be left.
        """
        spreads = []
        for surface in (self.lids, floors):
            spread = np.full(self.hull.size, np.nan)
            spread[self.index[surface.cells]] = surface.spread
            spreads.append(spread.reshape(self.hull.shape))
        lids, bottoms = spreads
        seen, _ = self.seen_from(self.lids.cells)
        believed = np.zeros_like(self.hull)
        for cells in self._parts(self.hull & ~floors.kept):
            bottom = bottoms[ndimage.binary_dilation(cells, WHOLE) & floors.kept]
            if _median(bottom) > better * _median(lids[cells]):
                continue
            lid = self._among(cells, self.lids)
            if not self.is_sheen(self.lids.cells[lid], seen[:, lid]):
                believed |= cells
        return believed

    def deepened(self, kept: np.ndarray) -> np.ndarray:
        """Cells [K, K, K] of `kept` without what lies above the floor that photos agree about best.

        Carving stops at the first floor that photos agree about well enough, and about one of one colour
        they do at many depths. So it goes on, layer by layer, to where they agree best, or nearly.
        """
        wall = ndimage.binary_dilation(self.held)
        surface, floors = self.look_at(kept), []
        while surface.opened <= OPENED:
            carved = ndimage.binary_dilation(self.hull & ~surface.kept, WHOLE)
            bare = ndimage.binary_dilation(carved, WHOLE) & ~self.held
            seen = ~np.isnan(surface.spread)
            floor = seen & self._among(bare, surface)
            if not floor.any():
                break
            disagreement = np.average(surface.spread[floor], weights=surface.times[floor])
            floors.append((disagreement, surface.kept))
            layer = self._grid(surface.cells[seen]) & carved & ~wall
            if layer.sum() < FEWEST:
                break
            surface = self.until_photos_agree(self.look_at(surface.kept & ~layer))
        if not floors:
            return kept
        least = min(disagreement for disagreement, _ in floors)
        return next(kept for disagreement, kept in floors if disagreement <= NEARLY * least)

    def is_sheen(self, cells: np.ndarray, seen: np.ndarray) -> bool:
        """True if photos disagree about `cells` [N] hardly more than by one colour for all of them each."""
        colours = np.stack([colours[cells] for colours in self.colours])
        colours[~seen] = np.nan
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # of cells and photos that see none
            shift = np.nanmedian(colours - np.nanmedian(colours, axis=0), axis=1)
        left = self._spread(cells, seen, np.nan_to_num(shift))
        return _median(left) < SHEEN * _median(self._spread(cells, seen))

    def _among(self, marked: np.ndarray, surface: _Surface) -> np.ndarray:
        """[N] bool: which of a surface's cells are `marked` [K, K, K]."""
        return marked.ravel()[self.index[surface.cells]]

    def _grid(self, cells: np.ndarray) -> np.ndarray:
        """[K, K, K] bool: the cells of these numbers."""
        grid = np.zeros(self.hull.size, dtype=bool)
        grid[self.index[cells]] = True
        return grid.reshape(self.hull.shape)

    def seen_from(self, cells: np.ndarray) -> tuple[np.ndarray, float]:
        """[photos, cells] bool: nothing is before a cell; and the share of masks where nothing is seen."""
        seen = np.zeros((len(self.masks), len(cells)), dtype=bool)
        opened = shown = 0
        for i, mask in enumerate(self.masks):
            place, depth = self.pixels[i][cells], self.depths[i][cells]
            nearest = np.full(mask.size, np.inf, dtype=np.float32)
            np.minimum.at(nearest, place, depth)
            nearest = ndimage.minimum_filter(nearest.reshape(mask.shape), 3)
            opened += np.isinf(nearest[mask]).sum()
            shown += mask.sum()
            seen[i] = np.isfinite(depth) & (depth <= nearest.ravel()[place] + 1.5 * self.edge)
        return seen, opened / max(shown, 1)

    def _spread(self, cells: np.ndarray, seen: np.ndarray, shift: np.ndarray | None = None) -> np.ndarray:
        """[cells] how far from their median most photos' colours are; NaN: too few see a cell.

        Args:
            shift: [photos, 3] sRGB, taken away from what each photo shows.
        """
        count = seen.sum(0)
        enough = count >= SEEN_BY
        spread = np.full(len(cells), np.nan)
        if not enough.any():
            return spread
        seen, last = seen[:, enough], count[enough] - 1
        colours = np.stack([colours[cells[enough]] for colours in self.colours])
        if shift is not None:
            colours -= shift[:, None]
        colours[~seen] = np.inf  # sorts behind what is seen
        middle = np.take_along_axis(np.sort(colours, axis=0), (last // 2)[None, :, None], axis=0)
        away = np.where(seen, np.linalg.norm(colours - middle, axis=-1), np.inf)
        most = (AGREEING * last).astype(int)
        spread[enough] = np.take_along_axis(np.sort(away, axis=0), most[None], axis=0)[0]
        return spread


def _median(values: np.ndarray) -> float:
    """Of those that are known; NaN: none is."""
    known = values[~np.isnan(values)]
    return float(np.median(known)) if len(known) else np.nan


def _surface(cells: np.ndarray) -> np.ndarray:
    """Those of the cells [K, K, K] that have a neighbour which is none of them."""
    return cells & ~ndimage.binary_erosion(cells)


def _finer(values: np.ndarray, known: np.ndarray, finer: int) -> np.ndarray:
    """[K·f, K·f, K·f] of f³ cells each, between values [K, K, K] that are `known` there."""
    nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    return ndimage.zoom(values[tuple(nearest)], finer, order=1, mode="nearest", grid_mode=True)


def _coarser(cells: np.ndarray, finer: int) -> np.ndarray:
    """[K/f, K/f, K/f] bool: any of f³ cells."""
    return skimage.measure.block_reduce(cells, finer, np.any)
