"""What stands on a support: photos are cut out, compared, and cut out again by what they say together."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor

import numpy as np
from scipy import ndimage

from ..capture.capture import evenly_taken
from ..threads import thread_pool
from .colour_counts import ColourCounts
from .ground import Ground, GroundColours
from .places import Places, PlacesIn, shown_by_all_but, times_seen
from .seen_space import cell_centres
from .standing import A_LITTLE, NO_PLACE, NOWHERE, Odds, Picture, Standing, by_support, outline_of
from .support import Support

CELLS, FINER = 80, 2
"""per axis of the grid over the region; and how many of the object's own are as long as one of those"""
LIFTED = 0.012
"""of the region's edge: what is lower is the support"""
SEEN_BY = 0.3
"""share of the photos that see a place where the object may be"""
FEW = (0.4, 0.4, 0.12, 0.12)
"""share of the photos that may take a place of the object for something else, in each turn"""
FEW_AT_LAST = 0.06
"""the same of the surface that is kept"""
MOST_VIEWS = 40
"""photos, evenly taken from all, that tell what the support looks like"""
AROUND = 3
"""cells around it where the object may be in the next turn"""
UNLIKE, LIKE = 4.0, 1.5
"""how unlike the support (`GroundColours.unlike`) is what may be the object, and what is none, before
anything else is known"""
BESIDE, MOST_LEFT_OUT = 3, 0.05
"""pixels from the object from which what is unlike the support is something else; and how much of that may
be, as a share of the object: with more, parts of it were not found"""
LIKELY = 0.1
"""odds of a place, by the support alone, from which the object may be there"""
MOST_OF_A_PLACE = 1.0
"""what a pixel says of places along its ray, at most; those that see past them, down to `NO_PLACE`, count
more"""


def find_standing(
    support: Support, pictures: Sequence[Picture], region: np.ndarray,
    progress: Callable[[float], None] = lambda done: None,
) -> Standing | None:  # fmt: skip
    """What stands on a support; None if nothing does.

    Args:
        region: [2, 3] world box.
    """
    with thread_pool() as pool:
        search = _Search(support, pictures, region, pool)
        for turn, few in enumerate(FEW):
            if not search.turn(few):
                return None
            progress((turn + 1) / len(FEW))
        return search.found()


class _Search:
    """Turns of cutting photos out and comparing what they show."""

    def __init__(self, support: Support, pictures: Sequence[Picture], region: np.ndarray, pool: Executor):
        self.support, self.pictures, self.pool = support, pictures, pool
        self.grid = cell_centres(region, CELLS)
        self.region, self.edge = region, float((region[1] - region[0]).max()) / CELLS
        centre = region.mean(0)
        distances = [np.linalg.norm(p.camera.position - centre) for p in pictures]
        pixel = np.median([d / p.camera.fx for d, p in zip(distances, pictures, strict=True)])
        self.ground = Ground.around(support, region, float(pixel))
        self.ground_cells = list(pool.map(lambda p: self.ground.cells_in(p.camera), pictures))
        self.telling = evenly_taken(len(pictures), MOST_VIEWS)
        cameras = [pictures[i].camera for i in self.telling]
        self.ground_pixels = list(pool.map(self.ground.pixels_in, cameras))
        lifted = support.above(self.grid) > LIFTED * CELLS * self.edge
        self.possible = self._seen_enough(np.flatnonzero(lifted))
        self.places = Places(self.grid[self.possible], self.edge)
        self.placed = self._placed(self.places)
        self.seen = times_seen(self.placed)
        self.kept = np.ones(len(self.possible), dtype=bool)
        self.masks: list[np.ndarray] | None = None
        self.everywhere = ColourCounts.of(p.colour.reshape(-1, 3) for p in pictures)

    def _seen_enough(self, cells: np.ndarray) -> np.ndarray:
        """Those of some of the grid's cells [N] that enough photos see."""
        points = self.grid[cells]
        seen = sum(self.pool.map(lambda p: p.camera.in_frame(points).astype(int), self.pictures))
        return cells[seen >= SEEN_BY * len(self.pictures)]

    def _placed(self, places: Places) -> list[PlacesIn]:
        return list(self.pool.map(lambda p: PlacesIn(places, p.camera, p.shape), self.pictures))

    def turn(self, few: float) -> bool:
        """Cut photos out once; false if no place is left that nearly all of them show."""
        colours = [picture.colour for picture in self.pictures]
        self.ground_colours = self._ground_colours(colours)
        unlike = self._unlike(colours)
        if self.masks is None:
            # What is under the object nobody sees.
            likely = self.places.centres[self._likely_by(unlike) > 0]
            below = self.ground.cells_below(likely, self.edge)
            self.ground_colours = self.ground_colours.unknown_in(below)
            unlike = self._unlike(colours)
        allowed = list(self.pool.map(lambda own: own.covered(A_LITTLE, self.kept), self.placed))
        if self.masks is None:
            shown, past = self._by_support(unlike)
        else:
            shown, past = self.masks, [~mask for mask in self.masks]
        if not any(mask.any() for mask in shown):
            return False
        own, beside = (
            ColourCounts.of(c[mask] for c, mask in zip(colours, masks, strict=True))
            for masks in (shown, past)
        )
        self.odds = Odds(own, beside, self.everywhere)
        odds = [
            np.where(near, self.odds.of(c, far), NOWHERE)
            for c, far, near in zip(colours, unlike, allowed, strict=True)
        ]
        self.likely = self._likely(odds)
        likeliest = self.pool.map(lambda own: own.highest(self.likely, NO_PLACE), self.placed)
        self.masks = list(self.pool.map(outline_of, colours, odds, allowed, likeliest))
        self.kept_last, self.unlike = self.kept, unlike
        self.object = shown_by_all_but(few, self.placed, self.masks, self.seen)
        self.kept = self._grown(self.object)
        return bool(self.object.any())

    def _ground_colours(self, colours: list[np.ndarray]) -> GroundColours:
        """What the support looks like where photos do not show the object, as far as is known."""
        told = [colours[i] for i in self.telling]
        hidden = None if self.masks is None else [self.masks[i] for i in self.telling]
        return GroundColours.seen_in(self.ground, self.ground_pixels, told, hidden)

    def _unlike(self, colours: list[np.ndarray]) -> list[np.ndarray]:
        return list(self.pool.map(self.ground_colours.unlike, colours, self.ground_cells))

    def _likely_by(self, unlike: list[np.ndarray]) -> np.ndarray:
        """Odds [N] of the places by the support alone."""
        return self._likely([np.nan_to_num(by_support(far)) for far in unlike])

    def _by_support(self, unlike: list[np.ndarray]) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Where photos show the object, [H, W] bool, and where something else, as far as is known at first:
        by places that photos do not see past."""
        likely = self._likely_by(unlike)
        shown, past = [], []
        for placed, far in zip(self.placed, unlike, strict=True):
            maybe = placed.highest(likely, NO_PLACE) > LIKELY
            shown.append(maybe & (far > UNLIKE))
            past.append(~maybe | (far < LIKE))
        return shown, past

    def _likely(self, odds: list[np.ndarray]) -> np.ndarray:
        """[N] mean of what pixels [H, W] say of each place."""

        def said(placed: PlacesIn, own: np.ndarray) -> np.ndarray:
            pixels = own.clip(NO_PLACE, MOST_OF_A_PLACE).astype(np.float32)
            return placed.values(ndimage.uniform_filter(pixels, 3))

        return sum(self.pool.map(said, self.placed, odds)) / self.seen

    def _grown(self, places: np.ndarray) -> np.ndarray:
        """Places [N] bool, and those around them."""
        grid = np.zeros(CELLS**3, dtype=bool)
        grid[self.possible] = places
        grown = ndimage.binary_dilation(grid.reshape((CELLS,) * 3), iterations=AROUND)
        return grown.ravel()[self.possible]

    def found(self) -> Standing | None:
        """What is known after the last turn; None if much else stands there that was not found."""
        kept = self.kept_last
        if self._left_out() > MOST_LEFT_OUT:
            return None
        return Standing(
            self.ground, self.ground_colours, self.odds, self.places.only(kept), self.likely[kept],
            self._surface(),
        )  # fmt: skip

    def _left_out(self) -> float:
        """What is unlike the support beside the object, and likely there by all photos, as a share of the
        object. A lamp that one of them sees in a polished table is not."""
        cell, likely = np.ones((3, 3)), self._likely_by(self.unlike)
        left = 0
        for placed, far, mask in zip(self.placed, self.unlike, self.masks, strict=True):
            around = ndimage.binary_dilation(mask, cell, BESIDE)
            maybe = placed.highest(likely, NO_PLACE) > LIKELY
            unlike = maybe & (np.nan_to_num(far) > UNLIKE) & ~around
            left += int(ndimage.binary_opening(unlike, cell).sum())
        return left / max(sum(int(mask.sum()) for mask in self.masks), 1)

    def _surface(self) -> Places:
        """The outermost cells, finer ones, of what nearly all photos show."""
        finer = np.arange(CELLS * FINER) // FINER
        may = np.zeros(CELLS**3, dtype=bool)
        may[self.possible] = self.kept
        may = may.reshape((CELLS,) * 3)[np.ix_(finer, finer, finer)]
        step = (self.region[1] - self.region[0]) / (CELLS * FINER)
        centres = self.region[0] + (np.argwhere(may) + 0.5) * step
        places = Places(centres, self.edge / FINER)
        placed = self._placed(places)
        solid = np.zeros(may.shape, dtype=bool)
        solid[may] = shown_by_all_but(FEW_AT_LAST, placed, self.masks, times_seen(placed))
        outermost = solid & ~ndimage.binary_erosion(solid)
        return places.only(outermost[may])
