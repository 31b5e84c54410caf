"""Air within a visual hull, by multi-view stereo: where rays pass to what photos of neighbours agree about.

Each photo votes, along each of its rays, for the place that its neighbours show alike: whose small patches
correlate best with its own, whatever light or tint each has (Vogiatzis et al. 2007,
doi:10.1109/TPAMI.2007.70712). What lies before that place is air, and what lies right behind it is not
(Hernández et al. 2007, doi:10.1109/CVPR.2007.383193). The image in a mirror lies behind that, as what is in
a hollow lies behind its lid, but few photos see it there, from one side, or all of the mirror would be air.
"""

from concurrent.futures import Executor
from typing import NamedTuple

import numpy as np
import skimage.measure
from scipy import ndimage

from ..capture.camera import Camera
from ..capture.frames import unit
from ..capture.photos import Photo, linear_to_srgb
from ..threads import mapped_ahead, thread_pool
from .seen_space import cell_centres

PATCH = 5
"""cells along the sides of the squares that are compared, across each axis"""
FAINT = 0.03
"""deviation of brightness within a patch, sRGB, below which there is nothing to compare"""
NEXT, ALIKE = 6, 3
"""neighbours whose photos each is compared with, and of how many the best correlations count: others see
something before the place"""
APART = (4.0, 50.0)
"""degrees that neighbours are apart"""
CERTAIN = 0.9
"""correlation from which on a photo has a vote"""
BEFORE, BEHIND = 0.5, 3.0
"""cells before the place voted for at which air ends, and behind it up to which there is none"""
WIDTH = 0.7
"""of the votes' blur, cells"""
DOUBT = 0.12
"""share of the photos that vote against air everywhere, as it were"""
AIR = 0.4
"""share of the votes that air has at least"""
OFTEN, ALL_AROUND = 0.235, 0.046
"""share of the photos that vote for air in a hollow, and share by which these votes outweigh the sum of
their directions, which is as long as they are if all come from one side"""
OPENED = 0.027
"""share of all rays that a hollow may leave hardly anything on: what has a hollow has a bottom, too"""
BARE, SHORT = 0.9, 4
"""share of a ray's cells that are air where hardly anything is left; rays with fewer cells do not count"""
SMALLEST = 0.003
"""share of the hull that such air has at least"""
WHOLE = np.ones((3, 3, 3), dtype=bool)
"""all neighbours of a cell, across edges and corners too"""


class _View(NamedTuple):
    """What a photo shows of N cells.

    Attributes:
        brightness: [N], sRGB; 0 out of frame. mean, deviation: [3, N] of it within each cell's patches.
        ray, depth: [N] which of the rays that are a cell apart passes the cell, 0: none; and how far away.
        directions: [N, 3] from the cells to the camera, unit vectors.
    """

    brightness: np.ndarray
    mean: np.ndarray
    deviation: np.ndarray
    ray: np.ndarray
    depth: np.ndarray
    directions: np.ndarray


def air_seen(
    cameras: list[Camera], photos: list[Photo], hull: np.ndarray, held: np.ndarray, box: np.ndarray
) -> np.ndarray:
    """How sure photos are that cells of a visual hull are air that is open to the outside.

    Args:
        photos: with alpha.
        hull, held: [K, K, K] bool of cells of the world box [2, 3]; what silhouettes hold is no air.

    Returns:
        [K, K, K] share of the votes, which is above `AIR` there; 0 but in and next to such cells.
    """
    with thread_pool() as pool:
        stereo = _Stereo(cameras, photos, hull, box, pool)
        votes = sum(mapped_ahead(pool, stereo.votes, range(len(cameras)))) / len(cameras)
    air, solid, *across = (ndimage.gaussian_filter(stereo.grid(some), WIDTH) for some in votes)
    around = air - np.linalg.norm(across, axis=0)
    share = air / (air + solid + DOUBT)
    outside = ndimage.binary_dilation(~hull)
    believed = np.zeros_like(hull)
    for part in parts_of(hull & ~held & (share > AIR), SMALLEST * hull.sum()):
        often = (part & outside).any() and np.median(air[part]) >= OFTEN
        if often and np.median(around[part]) >= ALL_AROUND and stereo.opened(part) <= OPENED:
            believed |= part
    return np.where(ndimage.binary_dilation(believed, WHOLE), share, 0.0)


def parts_of(cells: np.ndarray, smallest: float) -> list[np.ndarray]:
    """Parts of `cells` [K, K, K] that hang together, each [K, K, K], of at least `smallest` cells."""
    labels, count = ndimage.label(cells, WHOLE)
    parts = (labels == part for part in range(1, count + 1))
    return [part for part in parts if part.sum() >= smallest]


def reduced_photo(photo: Photo, smaller: int) -> tuple[np.ndarray, np.ndarray]:
    """Colours [h, w, 3], sRGB, not premultiplied, and alpha [h, w] of squares of so many pixels' sides."""
    reduced = skimage.measure.block_reduce(photo.pixels, (smaller, smaller, 1), np.mean)
    straight = reduced[..., :3] / np.maximum(reduced[..., 3:], 1e-3)
    return linear_to_srgb(straight).clip(0, 1), reduced[..., 3]


class _Stereo:
    """The cells of a hull, in what is cut out around it, and what each photo shows of them."""

    def __init__(
        self, cameras: list[Camera], photos: list[Photo], hull: np.ndarray, box: np.ndarray,
        pool: Executor,
    ):  # fmt: skip
        self.hull = hull
        around = hull[ndimage.find_objects(hull.astype(np.int8))[0]]
        self.shape, self.cells = around.shape, np.flatnonzero(around)
        self.edge = float((box[1] - box[0]).max()) / hull.shape[0]
        self.points = cell_centres(box, hull.shape[0]).reshape(*hull.shape, 3)[hull]
        self.filled = np.ones(1, dtype=np.float32)
        self.filled = self._in_patches(np.ones(len(self.points)))
        self.views = list(pool.map(self._view, cameras, photos))
        towards = unit(np.stack([view.directions.mean(0) for view in self.views]))
        apart = np.degrees(np.arccos((towards @ towards.T).clip(-1, 1)))
        self.near = [[i for i in np.argsort(row) if APART[0] < row[i] < APART[1]][:NEXT] for row in apart]
        pairs = {tuple(sorted((i, j))) for i, near in enumerate(self.near) for j in near}
        self.pairs = dict(zip(pairs, pool.map(self._correlation, pairs), strict=True))

    def _view(self, camera: Camera, photo: Photo) -> _View:
        pixel, depth = camera.project(self.points)
        depths = camera.depths_of_scale(self.points, depth)
        scale = max(camera.fx, camera.fy) / np.median(np.abs(depths))
        width = self.edge * scale
        smaller = max(1, int(width / 2))
        colours, alpha = reduced_photo(photo, smaller)
        cover = (alpha > 0.5).astype(np.float32)
        blur = 0.4 * width / smaller
        blurred = ndimage.gaussian_filter(colours.mean(-1) * cover, blur)
        blurred /= np.maximum(ndimage.gaussian_filter(cover, blur), 1e-3)
        rows, columns = photo.pixels.shape[:2]
        column, row = np.nan_to_num(pixel, nan=-1.0).T
        inside = (depth > 0) & (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        if photo.told is not None:
            at = row.clip(0, rows - 1).astype(int), column.clip(0, columns - 1).astype(int)
            inside &= photo.told[at]
        place = [row / smaller - 0.5, column / smaller - 0.5]
        shown = ndimage.map_coordinates(blurred, place, order=1, mode="nearest")
        brightness = np.where(inside, shown, 0).astype(np.float32)
        cell = (row // width) * (columns // width + 1) + column // width
        ray = np.unique(np.where(inside, cell, -1.0), return_inverse=True)[1] + inside.all()
        mean = self._in_patches(brightness)
        variance = self._in_patches(brightness**2) - mean**2
        directions = unit(camera.position - self.points)
        return _View(
            brightness, mean, np.sqrt(np.maximum(variance, FAINT**2)), ray,
            depth.astype(np.float32), directions.astype(np.float32),
        )  # fmt: skip

    def _in_patches(self, values: np.ndarray) -> np.ndarray:
        """[3, N]: means of `values` [N] over the hull's cells in a square across each axis."""
        grid = np.zeros(self.shape, dtype=np.float32)
        grid.ravel()[self.cells] = values
        sizes = PATCH - (PATCH - 1) * np.eye(3, dtype=int)
        means = (ndimage.uniform_filter(grid, size, mode="constant") for size in sizes)
        return np.stack([some.ravel()[self.cells] for some in means]) / self.filled

    def _correlation(self, pair: tuple[int, int]) -> np.ndarray:
        """[N]: how alike two photos show the cells, at most 1: across the axis along which they do most."""
        one, other = (self.views[number] for number in pair)
        together = self._in_patches(one.brightness * other.brightness) - one.mean * other.mean
        return (together / (one.deviation * other.deviation)).max(0)

    def votes(self, number: int) -> np.ndarray:
        """[5, N] of a photo: for air, for something, and for air times the direction to the camera."""
        view, near = self.views[number], self.near[number]
        if len(near) < ALIKE:
            return np.zeros((5, len(self.points)))
        alike = [self.pairs[tuple(sorted((number, other)))] for other in near]
        correlation = np.where(view.ray > 0, np.sort(alike, axis=0)[-ALIKE:].mean(0), -1.0)
        best = np.full(view.ray.max() + 1, CERTAIN)
        np.maximum.at(best, view.ray, correlation)
        place = np.full(len(best), np.nan)
        voted = correlation >= best[view.ray]
        place[view.ray[voted]] = view.depth[voted]
        beyond = (view.depth - place[view.ray]) / self.edge
        weight = best[view.ray]
        air = weight * (beyond < -BEFORE)
        solid = weight * ((beyond > -BEFORE) & (beyond < BEHIND))
        return np.stack([air, solid, *(air * view.directions.T)])

    def opened(self, cells: np.ndarray) -> float:
        """Share of all photos' rays that pass hardly any of the hull but these `cells` [K, K, K]."""
        bare = passed = 0
        for view in self.views:
            count = np.bincount(view.ray)
            long = count >= SHORT
            long[0] = False
            gone = np.bincount(view.ray, cells[self.hull])
            bare += (long & (gone >= BARE * count)).sum()
            passed += long.sum()
        return bare / max(passed, 1)

    def grid(self, values: np.ndarray) -> np.ndarray:
        """[K, K, K]: `values` [N] at the hull's cells, 0 elsewhere."""
        grid = np.zeros(self.hull.shape)
        grid[self.hull] = values
        return grid
