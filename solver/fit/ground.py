"""What a support looks like, by photos that see past the object; and what in a photo looks unlike it."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import ndimage

from ..capture.camera import Camera
from .support import Support

AROUND = 1.5
"""edge of what is looked at of a support, in longest edges of the region"""
MOST_CELLS = 512
"""per axis"""
FEWEST_VIEWS = 3
"""photos that must show a place for its colour to be known"""
ROWS = 16
"""of cells that are looked at together, for memory"""
SHEEN = 1 / 10
"""width over which a gloss changes a photo's colours evenly, as a share of the root of its pixels"""
LEAST_SPREAD, SPREAD = 1.6, 0.3
"""difference (CIE Lab) that is as good as none, and how much more of it where photos disagree"""
UNLIKE = 3.0
"""differences, counted in those, from which a pixel tells nothing of the gloss around it"""
DISAGREE = 3.0
"""times the usual spread from which photos disagree too much about a place: it is not on the support, or
the object hides it from most"""
ALIKE, FEW_ALIKE = 2.5, 0.1
"""difference (CIE Lab) up to which photos show one thing, and the share of those that show a place which
then say what it looks like, though most do not"""
AT_ONCE = 1500
"""cells whose photos are compared with each other at once, for memory"""


@dataclass(frozen=True, eq=False)
class Ground:
    """A grid of cells on a support around a region.

    Attributes:
        origin: [3] world, its first corner; `first`, `second`: unit vectors along its edges.
        edge: of a cell, world units. cells: per axis.
    """

    support: Support
    origin: np.ndarray
    first: np.ndarray
    second: np.ndarray
    edge: float
    cells: int

    @classmethod
    def around(cls, support: Support, region: np.ndarray, pixel: float) -> "Ground":
        """Cells as big as a pixel (`pixel`, world units), if they are not too many."""
        half = AROUND / 2 * float((region[1] - region[0]).max())
        cells = int(np.clip(2 * half / pixel, 32, MOST_CELLS))
        first, second = support.axes()
        centre = region.mean(0)
        centre = centre - support.above(centre) * support.normal
        return cls(support, centre - half * (first + second), first, second, 2 * half / cells, cells)

    @property
    def points(self) -> np.ndarray:
        """[cells · cells, 3] world centres."""
        steps = (np.arange(self.cells) + 0.5) * self.edge
        along = steps[:, None, None] * self.first + steps[None, :, None] * self.second
        return (self.origin + along).reshape(-1, 3)

    def cells_below(self, points: np.ndarray, closed: float) -> np.ndarray:
        """[cells · cells] bool: what is straight below world points [N, 3], or between such, if the gap is
        no wider than twice `closed` (world units)."""
        steps = (points - self.origin) @ np.stack([self.first, self.second], -1) / self.edge
        inside = ((steps >= 0) & (steps < self.cells)).all(1)
        below = np.zeros((self.cells, self.cells), dtype=bool)
        below[tuple(steps[inside].astype(int).T)] = True
        return _closed(below, int(np.ceil(closed / self.edge))).ravel()

    def cells_in(self, camera: Camera) -> np.ndarray:
        """[H, W] int32 cell that is where each pixel's ray meets the support; −1 for none, or where the
        photo says nothing."""
        row, column = np.mgrid[: camera.height, : camera.width].reshape(2, -1)
        origins, directions = camera.rays(column + 0.5, row + 0.5)
        down = directions @ self.support.normal
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = -self.support.above(origins) / down
            at = origins + distance[:, None] * directions - self.origin
            place = np.stack([at @ self.first, at @ self.second], -1) / self.edge
        meets = (distance > 0) & (place >= 0).all(1) & (place < self.cells).all(1)
        found = np.full(len(place), -1, np.int32)
        cell = place[meets].astype(np.int32)
        found[meets] = cell[:, 0] * self.cells + cell[:, 1]
        found = found.reshape(camera.height, camera.width)
        told = camera.told_at(found.shape)
        return found if told is None else np.where(told, found, -1)

    def pixels_in(self, camera: Camera) -> np.ndarray:
        """[cells · cells] int32 pixel, counted along rows, that shows each cell's centre; −1 for none."""
        shape = camera.height, camera.width
        (row, column), inside, _ = camera.pixels_of(self.points, shape)
        pixel = np.full(len(inside), -1, np.int32)
        pixel[inside] = row * shape[1] + column
        return pixel


@dataclass(frozen=True, eq=False)
class GroundColours:
    """CIE Lab `colour` [N, 3] of a ground's cells, and how far photos are from it, `spread` [N], NaN where
    that is not known; and by how few it is told, `by_few` [N] bool: most photos show something else."""

    colour: np.ndarray
    spread: np.ndarray
    by_few: np.ndarray | None = None

    @classmethod
    def seen_in(
        cls, ground: Ground, pixels: Sequence[np.ndarray], colours: Sequence[np.ndarray],
        hidden: Sequence[np.ndarray] | None,
    ) -> "GroundColours":  # fmt: skip
        """Medians of photos [H, W, 3] CIE Lab.

        What is under an overhang few photos see, and the others show the object there. So while nobody
        knows where that is, and photos disagree, those count of which most agree: the ground looks the
        same from wherever it is seen, and what hides it mostly does not.

        Args:
            pixels: where each photo has the cells (`Ground.pixels_in`).
            hidden: [H, W] bool each: what is no ground; None: that is not known yet.
        """
        if hidden is not None:
            pixels = [
                np.where((own >= 0) & ~mask.ravel()[own], own, -1)
                for own, mask in zip(pixels, hidden, strict=True)
            ]
        count = ground.cells**2

        def shown(rows: np.ndarray | slice) -> np.ndarray:
            """[photos, N, 3] of cells; NaN where a photo does not show one."""
            return np.stack([
                np.where((own[rows] >= 0)[:, None], photo.reshape(-1, 3)[own[rows]], np.nan)
                for own, photo in zip(pixels, colours, strict=True)
            ])  # fmt: skip

        colour = np.full((count, 3), np.nan, np.float32)
        spread = np.full(count, np.nan, np.float32)
        for start in range(0, count, ROWS * ground.cells):
            found = shown(slice(start, start + ROWS * ground.cells))
            told = (~np.isnan(found[..., 0])).sum(0) >= FEWEST_VIEWS
            if told.any():
                rows = np.flatnonzero(told) + start
                colour[rows], spread[rows] = _medians(found[:, told])
        if hidden is not None:
            return cls(colour, spread)
        disputed = spread > DISAGREE * max(cls(colour, spread).usual, 1.0)
        rows = np.flatnonzero(disputed)
        for some in np.split(rows, range(AT_ONCE, len(rows), AT_ONCE)):
            found, enough = _most_alike(shown(some))
            colour[some[enough]], spread[some[enough]] = _medians(found[:, enough])
        return cls(colour, spread, disputed)

    def unknown_in(self, cells: np.ndarray) -> "GroundColours":
        """The same without what all photos tell of some cells [N] bool: what stands there looks the same
        from everywhere."""
        return replace(self, spread=np.where(cells & ~self.by_few, np.nan, self.spread))

    @cached_property
    def usual(self) -> float:
        """The spread of most cells."""
        return float(np.nanmedian(self.spread)) if np.isfinite(self.spread).any() else 0.0

    def unlike(self, photo: np.ndarray, cell: np.ndarray) -> np.ndarray:
        """How much a photo's pixels [H, W, 3] differ from the ground behind them, [H, W]: about 1 is usual;
        NaN where it is not known.

        A gloss brightens the ground differently from everywhere, but smoothly; that is taken off first.

        Args:
            cell: [H, W] as `Ground.cells_in` has it.
        """
        usual = self.usual
        spread = np.where(cell >= 0, self.spread[cell], np.nan)
        known = spread <= DISAGREE * max(usual, 1.0)
        least = LEAST_SPREAD + SPREAD * np.maximum(np.nan_to_num(spread), usual)
        difference = np.where(known[..., None], photo - self.colour[cell], 0)
        width = SHEEN * known.size**0.5
        # Twice, since only without the object does the first guess say what is sheen.
        like = known & (np.linalg.norm(difference, axis=-1) < 2 * UNLIKE * least)
        for _ in range(2):
            share = ndimage.gaussian_filter(like.astype(np.float32), width) + 1e-3
            sheen = np.stack(
                [ndimage.gaussian_filter(difference[..., c] * like, width) / share for c in range(3)], -1
            )
            found = np.linalg.norm(difference - sheen, axis=-1) / least
            like = known & (found < UNLIKE)
        return np.where(known, found, np.nan)


def _medians(found: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Median colours [N, 3] of what photos show, [photos, N, 3], and how far [N] these are from it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        colour = np.nanmedian(found, axis=0)
        return colour, np.nanmedian(np.linalg.norm(found - colour, axis=-1), axis=0)


def _most_alike(found: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What photos show, [photos, N, 3], of those alone that show the same as the most others, and whether
    these are enough [N]."""
    same = np.linalg.norm(found[:, None] - found[None], axis=-1) <= ALIKE
    count, cell = same.sum(1), np.arange(found.shape[1])
    best = count.argmax(0)
    fewest = np.maximum(FEWEST_VIEWS, FEW_ALIKE * (~np.isnan(found[..., 0])).sum(0))
    alike = np.where(same[best, :, cell].T[..., None], found, np.nan)
    return alike, count[best, cell] >= fewest


def _closed(cells: np.ndarray, by: int) -> np.ndarray:
    """Cells [K, K] bool, and gaps between them up to twice `by` wide."""
    return ndimage.binary_closing(np.pad(cells, by), np.ones((3, 3)), by)[by:-by, by:-by]
