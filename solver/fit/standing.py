"""Where a photo shows what stands on a support: a table, a floor, a lawn.

Three things tell. Where a pixel's ray meets the support, other photos say what is there; even a mirror is
unlike it nearly everywhere. Elsewhere, colours seen beside the object are likely behind it, too. And what
photos together say of a place in space holds for each (Campbell et al. 2010,
doi:10.1016/j.imavis.2008.09.005).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from ..capture.backdrop import border_of
from ..capture.camera import Camera
from .colour_counts import ColourCounts
from .ground import Ground, GroundColours
from .outline import cut
from .places import Places, PlacesIn

MOST = 3.0
"""logarithm of the odds that a pixel tells by the support, at most, one way or the other"""
MOST_BY_COLOUR = 4.0
EVEN, STEEP, COLOUR_TOO = 2.2, 1.5, 0.3
"""how unlike the support a pixel is that may as well be the object, how fast the odds change there, and how
much its colour counts beside that"""
ELSEWHERE = -0.3
"""what counts besides, where no support is behind a pixel"""
FOUND = 0.7
"""share of the object's pixels, and of those beside it, that have colours found there; the rest has any"""
NOWHERE = -30.0
NO_PLACE = -3.0
"""odds of a place where the object is not, and those beside all places"""
HIGHLIGHT = 0.5
"""odds of the places behind a hole in the object from which it is a highlight"""
WITHIN, AT_LAST = 1 / 16, 1 / 128
"""what outlines cost between pixels of one colour (`outline.cut`): much while all of the object is to be
found, as a whole; and little when it is known about where each of them runs"""
A_LITTLE = 0.05
"""share of a place, in a picture, from which the object may be there"""


@dataclass(frozen=True, eq=False)
class Picture:
    """A photo as it is looked at here: `colour` [H, W, 3] CIE Lab."""

    camera: Camera
    colour: np.ndarray

    @property
    def shape(self) -> tuple[int, int]:
        return self.colour.shape[:2]


class Outline(NamedTuple):
    """Where a photo shows the object, [H, W] bool, and where that is not sure."""

    shown: np.ndarray
    unsure: np.ndarray


class Odds(NamedTuple):
    """By which pixels are judged: colours of the object, beside it, and of photos as a whole."""

    own: ColourCounts
    beside: ColourCounts
    everywhere: ColourCounts

    def of(self, colour: np.ndarray, unlike: np.ndarray) -> np.ndarray:
        """Logarithm of the odds [H, W] that pixels [H, W, 3] CIE Lab show the object.

        Args:
            unlike: [H, W] the support (`GroundColours.unlike`).
        """
        any_colour = (1 - FOUND) * self.everywhere.likelihood(colour)
        its = FOUND * self.own.likelihood(colour) + any_colour
        not_its = FOUND * self.beside.likelihood(colour) + any_colour
        by_colour = np.log(its / not_its).clip(-MOST_BY_COLOUR, MOST_BY_COLOUR) + ELSEWHERE
        both = by_support(unlike) + COLOUR_TOO * by_colour
        return np.where(np.isfinite(unlike), both, by_colour)


def by_support(unlike: np.ndarray) -> np.ndarray:
    """Logarithm of the odds [H, W] that pixels so `unlike` the support show the object; NaN as that."""
    return (STEEP * (unlike - EVEN)).clip(-MOST, MOST)


@dataclass(frozen=True, eq=False)
class Standing:
    """What is known of the object and of what is around it, by which any photo of it is cut out.

    Attributes:
        ground, ground_colours: the support, and what it looks like.
        odds: by which pixels are judged.
        places: where the object may be. likely: [N] logarithm of the odds that it is there.
        surface: the outermost cells of what nearly all photos show.
    """

    ground: Ground
    ground_colours: GroundColours
    odds: Odds
    places: Places
    likely: np.ndarray
    surface: Places

    def outline(self, picture: Picture) -> Outline:
        """Where a photo shows the object: by itself along the outline, by all photos elsewhere."""
        unlike = self.ground_colours.unlike(picture.colour, self.ground.cells_in(picture.camera))
        places = PlacesIn(self.places, picture.camera, picture.shape)
        shown = outline_of(
            picture.colour, self.odds.of(picture.colour, unlike), places.covered(A_LITTLE),
            places.highest(self.likely, NO_PLACE), AT_LAST,
        )  # fmt: skip
        surface = PlacesIn(self.surface, picture.camera, picture.shape)
        others = surface.covered()
        edge = np.ones((3, 3)), surface.size
        sure = ndimage.binary_erosion(others, *edge, border_value=1)
        maybe = ndimage.binary_dilation(others, *edge) & ~sure
        return Outline(sure | (shown & maybe), np.where(maybe, shown != others, sure & ~shown))


def outline_of(
    colour: np.ndarray, odds: np.ndarray, allowed: np.ndarray, likely: np.ndarray, within: float = WITHIN
) -> np.ndarray:
    """[H, W] bool: what the odds [H, W] make of a photo, where the object is `allowed`, [H, W].

    Args:
        colour: [H, W, 3] CIE Lab. likely: [H, W] odds of the likeliest place along each ray. within:
            see `outline.cut`.
    """
    mask = cut(colour, np.where(allowed, odds + likely, NOWHERE), within)
    # A highlight leaves a hole. So does a handle, but through that photos see past the object.
    holes, count = ndimage.label(~mask)
    if count > 1:
        filled = ndimage.mean(likely, holes, np.arange(count + 1)) > HIGHLIGHT
        filled[border_of(holes)] = False
        filled[0] = False
        mask |= filled[holes]
    return mask
