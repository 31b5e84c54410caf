"""Small cells of space, and where pictures show them: what all photos together say of a place."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from ..capture.camera import Camera


class Places(NamedTuple):
    """Centres [N, 3], world, of cells with this edge, world units."""

    centres: np.ndarray
    edge: float

    def only(self, chosen: np.ndarray) -> "Places":
        """Some of them, [N] bool."""
        return Places(self.centres[chosen], self.edge)


class PlacesIn:
    """Where places are in a picture of so many rows and columns.

    There, each is a block of pixels as big as its cell, so that there are no gaps between centres.
    """

    def __init__(self, places: Places, camera: Camera, shape: tuple[int, int]):
        (row, column), self.inside, depth = camera.pixels_of(places.centres, shape)
        self._at = (row * shape[1] + column).astype(np.int32)
        depth = camera.depths_of_scale(places.centres[self.inside], depth)
        scale = camera.fx * shape[1] / camera.width
        size = places.edge * scale / np.median(depth) if len(depth) else 1.0
        self.size = max(1, int(np.ceil(size)))
        """pixels along the edge of a block"""
        self._shape = shape
        self._blocks = tuple(-(-side // self.size) for side in shape)
        self._block = (row // self.size * self._blocks[1] + column // self.size).astype(np.int32)

    def values(self, picture: np.ndarray) -> np.ndarray:
        """[N] float32 of a picture [H, W] at the places' centres; 0 where these are out of the frame."""
        found = np.zeros(len(self.inside), np.float32)
        found[self.inside] = picture.ravel()[self._at]
        return found

    def highest(self, values: np.ndarray, beside: float) -> np.ndarray:
        """[H, W]: the highest of the places' values [N] along each pixel's ray; smoothly less next to it.

        Args:
            beside: what is where no place is.
        """
        blocks = np.full(self._blocks[0] * self._blocks[1], beside, np.float32)
        np.maximum.at(blocks, self._block, values[self.inside].astype(np.float32))
        pixels = blocks.reshape(self._blocks).repeat(self.size, 0).repeat(self.size, 1)
        smooth = ndimage.gaussian_filter(pixels, self.size / 2)
        return smooth[: self._shape[0], : self._shape[1]]

    def covered(self, share: float = 0.5, chosen: np.ndarray | None = None) -> np.ndarray:
        """[H, W] bool: where places are, or those `chosen`, [N]; for a small share, a little beyond."""
        there = np.ones(len(self.inside)) if chosen is None else chosen
        return self.highest(there, 0.0) > share


def times_seen(found: Sequence[PlacesIn]) -> np.ndarray:
    """[N] float32: in how many pictures each place is."""
    return sum(own.inside.astype(np.float32) for own in found)


def shown_by_all_but(
    few: float, found: Sequence[PlacesIn], masks: Sequence[np.ndarray], seen: np.ndarray
) -> np.ndarray:
    """[N] bool: places that masks [H, W] show, but for a share `few` of the pictures in which they are.

    Args:
        seen: [N] `times_seen`.
    """
    shown = sum(own.values(mask) for own, mask in zip(found, masks, strict=True))
    return seen - shown <= few * seen
