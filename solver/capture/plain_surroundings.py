"""An object before a plain backdrop of any colour, evenly or unevenly lit: where photos show it.

A paper sweep or a cloth has no edges, and it reaches the edges of a photo. So what is even, and connected
with the photo's edge by what is even, is backdrop, whatever its colour and however it fades.
"""

from typing import NamedTuple

import numpy as np
from scipy import ndimage

from .backdrop import border_of, border_share, without_dust
from .told import filled

SLOPE = 3 / 255
"""change of colour from pixel to pixel, sRGB, up to which a picture is even"""
SOFTENED = 1.0
"""pixels over which it is taken, against noise"""
NARROW = 2
"""pixels to both sides of a gap between the object and its outline through which nothing runs out"""
WIDENED = 6
"""pixels that an edge so widens to both sides, at most"""
SAME = 8 / 255
"""levels, sRGB, by which pixels there may differ from the backdrop beside them: traces of JPEG"""
LEAST_BORDER = 0.1
"""share of the photo's border that an even part of the backdrop takes, at least; others are the object's"""
EVEN_BORDER, LEAST_AROUND = 0.8, 0.5
"""share of the border that a backdrop takes of most photos, and that is even in any"""


class Surroundings(NamedTuple):
    """Of a photo of H × W pixels.

    Attributes:
        shown: [H, W] bool: the object.
        behind: [H, W, 3] sRGB: the backdrop, before the object that of the nearest pixel beside it.
    """

    shown: np.ndarray
    behind: np.ndarray

    @property
    def share(self) -> float:
        """How much of the photo's border is backdrop."""
        return 1 - border_share(self.shown)


def surroundings_of(colour: np.ndarray) -> Surroundings | None:
    """What is plain around the object in a photo, [H, W, 3] sRGB; None if little at its edge is."""
    even = _slope(colour) <= SLOPE
    if border_share(even) < LEAST_AROUND:
        return None
    even = ndimage.binary_erosion(even, iterations=NARROW, border_value=1)
    parts, _ = ndimage.label(even)
    border = border_of(parts)
    along = np.bincount(border, minlength=parts.max() + 1)
    plain = (along >= LEAST_BORDER * len(border))[parts] & even
    if not plain.any():
        return None
    behind = filled(colour, plain)
    alike = (np.abs(colour - behind) <= SAME).all(-1)
    plain = ndimage.binary_dilation(plain, iterations=WIDENED, mask=plain | alike)
    return Surroundings(without_dust(~plain), behind)


def _slope(colour: np.ndarray) -> np.ndarray:
    """[H, W] the steepest channel's change per pixel."""
    slopes = [
        ndimage.gaussian_gradient_magnitude(channel, SOFTENED, mode="nearest")
        for channel in np.moveaxis(colour, -1, 0)
    ]
    return np.max(slopes, axis=0)
