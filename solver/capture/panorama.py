"""What is far behind an object, direction by direction: photos from many sides make a panorama of it.

Far means that it has no parallax: all photos that look past the object in one direction show the same.
A scene that was rendered with its HDRI is so, and an object high before a landscape.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from .backdrop import border_of
from .camera import Camera
from .frames import equirect_from_direction, texel_directions, unit
from .told import filled

SAME = 8 / 255
"""levels, sRGB, by which two photos of one thing differ: traces of JPEG"""
HEIGHTS = (256, 512, 1024, 2048)
"""rows that a panorama may have"""
PER_TEXEL = 1.5
"""pixels that a texel is wide, at most"""
HALF = 0.5
"""share of the other photos that have to agree: those to whom the object itself is in the way cannot"""
FAR_BORDER = 0.65
"""share of what two other photos see, too, of a photo's border, that agrees where surroundings are far.
Medians of captures before an HDRI are 0.79 and more, of rooms, gardens and streets 0.46 and less"""
SEEN_BORDER = 0.2
"""how much of the border two others have to see"""
PROBED = 8
"""photos, evenly taken from all, that tell whether surroundings are far"""


@dataclass(frozen=True, eq=False)
class Panorama:
    """Directions are those of the cameras' world, in Blender's equirectangular convention (`frames`).

    Attributes:
        colour: [H, 2H, 3] float32, in the photos' encoding; 0 where it is not known.
        known: [H, 2H] bool: some photo shows it.
    """

    colour: np.ndarray
    known: np.ndarray

    @property
    def height(self) -> int:
        return len(self.known)

    def smaller(self, height: int) -> "Panorama":
        """The panorama with as many rows: means of what is known, where that is half of a texel or more.

        Args:
            height: divides the panorama's.
        """
        times = self.height // height

        def sums(values: np.ndarray) -> np.ndarray:
            return values.reshape(height, times, 2 * height, times, -1).sum((1, 3))

        count = sums(self.known.astype(np.float32))
        known = count[..., 0] >= 0.5 * times * times
        return Panorama(sums(self.colour) / np.maximum(count, 1) * known[..., None], known)

    def filled_where(self, wanted: Callable[[np.ndarray], np.ndarray]) -> "Panorama":
        """The panorama in directions [N, 3] that are wanted, [N] bool, alone; there its gaps have the
        colour of what is next to them."""
        inside = wanted(_texels(self.height)).reshape(self.known.shape)
        if not (self.known & inside).any():
            return Panorama(np.zeros_like(self.colour), np.zeros_like(self.known))
        return Panorama(filled(self.colour, self.known & inside) * inside[..., None], inside)

    def behind(self, camera: Camera, shape: tuple[int, int]) -> "Behind":
        """What is behind the pixels of a camera's photo of `shape` rows and columns."""
        size = np.array([2 * self.height, self.height])
        column, row = (equirect_from_direction(_directions(camera, shape)) * size).astype(int).T
        at = row.clip(0, self.height - 1), column % (2 * self.height)
        colour, low, high = (values[at].reshape(*shape, 3) for values in (self.colour, *self._extremes))
        return Behind(colour, low, high, self.known[at].reshape(shape))

    @cached_property
    def _extremes(self) -> tuple[np.ndarray, np.ndarray]:
        """The least and the greatest [H, 2H, 3] of a texel and those beside it: a texel holds a mean."""
        known = self.known[..., None]
        low = np.where(known, self.colour, np.float32(np.inf))
        high = np.where(known, self.colour, np.float32(-np.inf))
        modes = ["nearest", "wrap", "nearest"]
        return (
            ndimage.minimum_filter(low, (3, 3, 1), mode=modes),
            ndimage.maximum_filter(high, (3, 3, 1), mode=modes),
        )


class Behind(NamedTuple):
    """What is behind the pixels of a photo."""

    colour: np.ndarray  # [H, W, 3]
    low: np.ndarray  # [H, W, 3] the least and the greatest of it close by
    high: np.ndarray
    known: np.ndarray  # [H, W] bool

    def is_seen_in(self, colour: np.ndarray) -> np.ndarray:
        """[H, W] bool: where a photo [H, W, 3] shows that, and no object before it."""
        same = (colour >= self.low - SAME) & (colour <= self.high + SAME)
        return self.known & same.all(-1)


def panorama_of(
    cameras: Sequence[Camera], colours: Iterable[np.ndarray], shown: Sequence[np.ndarray],
    close: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]] | None = None,
    most_rows: int = HEIGHTS[-1],
) -> Panorama:  # fmt: skip
    """The panorama that photos [H, W, 3] show beside what is `shown` [H, W] of the object in each: their
    mean.

    Args:
        close: the world points [N, 3] that are seen in directions [N, 3], and which of them [N] are known
            and close by (`Floor.places`); None: all is far away.
        most_rows: of the panorama, where so many will do.
    """
    sharpest = min(
        camera.pixel_angle * camera.width / mask.shape[1]
        for camera, mask in zip(cameras, shown, strict=True)
    )
    height = next((h for h in HEIGHTS if np.pi / h <= PER_TEXEL * sharpest), HEIGHTS[-1])
    height = min(height, most_rows)
    directions = _texels(height)
    total, count = np.zeros_like(directions), np.zeros(len(directions), np.int32)
    if close is not None:
        places, is_close = close(directions)
        places = places[is_close]
    towards = directions.copy()
    for camera, colour, object_ in zip(cameras, colours, shown, strict=True):
        if close is not None:
            towards[is_close] = unit(places - camera.position)
        near = np.flatnonzero(towards @ camera.view_direction >= _cosine_of_cone(camera) - 1e-6)
        at, inside, _ = camera.pixels_of(camera.position + towards[near], object_.shape)
        free = ~object_[at]
        texel = near[inside][free]
        total[texel] += colour[at][free]
        count[texel] += 1
    mean = total / np.maximum(count, 1)[:, None]
    return Panorama(mean.reshape(height, -1, 3), (count > 0).reshape(height, -1))


class Agreement(NamedTuple):
    """How far other photos show the same as one, far away in the directions of its pixels."""

    seen: np.ndarray  # [H, W] other photos that look there
    agreeing: np.ndarray  # [H, W] those of them that show the same colour

    @property
    def is_far(self) -> np.ndarray:
        """[H, W] bool: most of them do, so that is what is far behind the object, and not the object."""
        return (self.seen > 0) & (self.agreeing >= HALF * self.seen)


class Comparison:
    """Photos that are compared with each other by directions.

    Args:
        cameras, colours: matching lists; colours are [H, W, 3] sRGB, of any size.
    """

    def __init__(self, cameras: Sequence[Camera], colours: Sequence[np.ndarray]):
        self.cameras, self.colours = cameras, colours
        # What lies between two pixels counts as well, also between a panorama's last and its first column.
        modes = [["reflect", "wrap" if c.is_panoramic else "reflect", "reflect"] for c in cameras]
        around = list(zip(colours, modes, strict=True))
        self._low = [ndimage.minimum_filter(c, (3, 3, 1), mode=m) - SAME for c, m in around]
        self._high = [ndimage.maximum_filter(c, (3, 3, 1), mode=m) + SAME for c, m in around]
        self._axes = np.stack([camera.view_direction for camera in cameras])
        self._cones = np.arccos([_cosine_of_cone(camera) for camera in cameras])

    def agreement(self, index: int) -> Agreement:
        colour = self.colours[index]
        shape = colour.shape[:2]
        directions = _directions(self.cameras[index], shape)
        seen, agreeing = np.zeros((2, len(directions)), np.int32)
        colour = colour.reshape(-1, 3)
        apart = np.arccos(np.clip(self._axes @ self._axes[index], -1, 1))
        for other in np.flatnonzero(apart < self._cones + self._cones[index]):
            if other == index:
                continue
            camera, shown = self.cameras[other], self.colours[other].shape[:2]
            at, inside, _ = camera.pixels_of(camera.position + directions, shown)
            same = (colour[inside] >= self._low[other][at]) & (colour[inside] <= self._high[other][at])
            seen[inside] += 1
            agreeing[inside] += same.all(-1)
        return Agreement(seen.reshape(shape), agreeing.reshape(shape))

    def is_far(self) -> bool:
        """True if photos agree about what is at their edges as if it were far away."""
        shares = []
        for index in range(0, len(self.cameras), max(1, len(self.cameras) // PROBED)):
            found = self.agreement(index)
            told = self.cameras[index].told_at(found.seen.shape)
            seen, far = (_rim_of(v, told) for v in (found.seen > 1, found.is_far))
            shares.append(far[seen].mean() if seen.mean() >= SEEN_BORDER else 0.0)
        return bool(np.median(shares) >= FAR_BORDER)


def _rim_of(values: np.ndarray, told: np.ndarray | None) -> np.ndarray:
    """Values [N] of those [H, W] along a photo's edges, where it is `told` [H, W]; None: all around. Of a
    fisheye's image, those along the edge of that."""
    border = border_of(values)
    if told is None:
        return border
    there = border_of(told)
    if there.mean() >= HALF:
        return border[there]
    return values[told & ~ndimage.binary_erosion(told)]


def _texels(height: int) -> np.ndarray:
    """Unit directions [2·height², 3] float32 of the texels of a panorama of `height` rows."""
    return texel_directions(height, 2 * height).reshape(-1, 3).astype(np.float32)


def _directions(camera: Camera, shape: tuple[int, int]) -> np.ndarray:
    """Unit world directions [H·W, 3] through the pixels of a camera's photo of `shape` rows and columns."""
    row, column = np.mgrid[0 : shape[0], 0 : shape[1]] + 0.5
    scale = camera.width / shape[1], camera.height / shape[0]
    return camera.rays(column.ravel() * scale[0], row.ravel() * scale[1])[1]


def _cosine_of_cone(camera: Camera) -> float:
    """Cosine between the optical axis and what a photo's edge shows farthest from it; −1 of a panorama."""
    if camera.is_panoramic:
        return -1.0
    width, height = camera.width, camera.height
    along = np.linspace(0, 1, 9)
    column = np.concatenate([along * width, along * width, 0 * along, 0 * along + width])
    row = np.concatenate([0 * along, 0 * along + height, along * height, along * height])
    return float((camera.rays(column, row)[1] @ camera.view_direction).min())
