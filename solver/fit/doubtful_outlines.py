"""Outlines that do not count: where the masks of photos disagree about where the object ends.

A mask from a network or a brush ends a pixel too early in one photo and too late in the next. A hull of
all is as narrow as the narrowest, and a shape that is fitted to all is in between and blurred. What photos
show within outlines tells where surfaces are, too. So, where masks do not fit each other, pixels along
outlines are left out until a shape stands without them; and from then on those that it disagrees with, for
which it is looked again: a trimmed fit (Rousseeuw 1984, doi:10.1080/01621459.1984.10477105).
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import torch
from scipy import ndimage
from torch import Tensor

from ..capture.capture import Capture
from ..capture.errors import listed
from ..capture.photos import Photo, at_sizes_of
from ..capture.told import both
from ..render.image import ray_opacity
from ..render.scene import RenderSettings, Scene
from .mask_outlines import along_outlines, masks_of, near_outlines
from .outline_gap import made_small, outline_gap
from .ray_bank import RayBank

FIT = 0.1
"""pixels, of photos in which the object measures `outline_gap.OBJECT_PIXELS`, that outlines of what is not
thin may lie outside of the hull of all: of right masks up to 0.08, of those that are off by a hundredth of
the object 0.14 and more"""
WIDER, HIDDEN = 2.0, 0.2
"""what is in doubt, by those pixels: some outlines are farther from the hull than the mean, and what its
cells hide"""
AGAIN, EVERY = 0.25, 0.1
"""fractions of the fit from which on pixels that agree count, and from one look to the next"""
NEVER = 2.0
"""a fraction that no fit comes to"""
DISAGREES = 0.3
"""between a pixel's alpha and the shape's opacity"""
GRID = 2
"""rays across a pixel, by which its opacity is told"""
TOLD_FROM = 0.1
"""pixels left out, by those next to outlines, from which a person is told"""
NAMED, FEW = 0.75, 0.4
"""of the largest share of a photo's outlines: photos with no less are named, if they are few of all"""


def doubtful_width(capture: Capture, photos: list[Photo], region: np.ndarray) -> int:
    """Pixels from outlines within which masks are in doubt; 0: they fit each other, or it cannot be told.

    Alpha that a job has made itself is told from a backdrop, which knows edges better.

    Args:
        region: [2, 3] world box that holds the object.
    """
    made = any(photo.backdrop is not None or photo.behind is not None for photo in photos)
    if made or any(camera.is_panoramic for camera in capture.cameras):
        return 0
    small, factor = made_small(photos)
    cameras = list(at_sizes_of(small, capture).cameras)
    gap = outline_gap(cameras, lambda: masks_of(small), region, lambda: map(_solid_outline, small))
    if gap is None or gap < FIT:
        return 0
    return max(round((WIDER * gap + HIDDEN) / factor), 1)


def _solid_outline(photo: Photo) -> np.ndarray:
    """[H, W] bool: next to outlines of what is not thin, but not to what a photo says nothing of."""
    near = near_outlines(photo.pixels[..., 3] > 0.5, 1)
    return near if photo.told is None else near & ndimage.binary_erosion(photo.told, np.ones((3, 3)))


def without_outlines(photos: list[Photo], width: int) -> list[Photo]:
    """Photos that say nothing of what is so many pixels along their outlines."""
    if width == 0:
        return photos
    near = (near_outlines(photo.pixels[..., 3] > 0.5, width) for photo in photos)
    return [replace(photo, told=both(photo.told, ~some)) for photo, some in zip(photos, near, strict=True)]


class DoubtfulOutlines:
    """Leaves out of a fit, over its course, pixels along outlines.

    Attributes:
        width: pixels from outlines within which they are in doubt; 0: nowhere.
        next_look: fraction of the fit from which on it is looked again for what the shape disagrees with.
        left_out: [K] long, the bank's pixels that do not count.
    """

    def __init__(self, bank: RayBank):
        self._bank = bank
        self._along: tuple[Tensor, Tensor] | None = None
        self.width, self.next_look = 0, NEVER
        self.left_out = torch.empty(0, dtype=torch.long, device=bank.device)

    def begin(self, width: int) -> None:
        """Leave out all that is in doubt, so many pixels along outlines, until a shape stands."""
        if width > 0:
            self.width, self.next_look = width, AGAIN
            self._leave_out(self._in_doubt()[0])

    def look(self, scene: Scene, settings: RenderSettings, fraction: float) -> None:
        """Leave out what the shape disagrees with at a fraction of the fit, if it is time."""
        if fraction < self.next_look:
            return
        self.next_look = fraction + EVERY
        pixels, _ = self._in_doubt()
        batch = self._bank.batch(pixels, GRID)
        origins = batch.origins.repeat_interleave(GRID * GRID, 0)
        opacity = ray_opacity(scene, settings, origins, batch.directions.flatten(0, 1))
        error = opacity.view(-1, GRID * GRID).mean(1) - batch.alpha
        self._leave_out(pixels[error.abs() > DISAGREES])

    def state(self) -> dict[str, float]:
        """All but what is left out."""
        return {"width": self.width, "next_look": self.next_look}

    def restore(self, state: dict[str, float], left_out: Tensor) -> None:
        """Go on as before."""
        self.width, self.next_look = state["width"], state["next_look"]
        if self.width > 0:
            self._leave_out(left_out)

    def told(self, names: list[str]) -> str | None:
        """What to tell a person of it, given the photos' names; None: nothing."""
        if self.width == 0:
            return None
        pixels, steps = self._in_doubt()
        out, along = (self._bank.counted_by_photo(some) for some in (self.left_out, pixels[steps == 1]))
        if out.sum() < TOLD_FROM * along.sum():
            return None
        shares = out / np.maximum(along, 1)
        worst = [i for i in np.argsort(-shares, kind="stable") if shares[i] >= NAMED * shares.max()]
        most = f" (most in {listed([names[i] for i in worst])})" if len(worst) <= FEW * len(names) else ""
        return (
            f"outlines of masks do not fit together: {out.sum() / along.sum():.0%} of the pixels along "
            f"them do not count, as other photos show otherwise{most}; better masks make a better result "
            "(fit.doubt_outlines=no lets all count)"
        )

    def _in_doubt(self) -> tuple[Tensor, Tensor]:
        """The bank's pixels [K] that are in doubt, and their steps from outlines."""
        if self._along is None:
            found = [along_outlines(mask, self.width) for mask in self._masks()]
            starts = self._bank.first_pixel[:-1]
            pixels = np.concatenate([start + some for start, (some, _) in zip(starts, found, strict=True)])
            steps = np.concatenate([steps for _, steps in found])
            likely = self._bank.are_likely(pixels)
            device = self._bank.device
            self._along = tuple(torch.from_numpy(some[likely]).to(device) for some in (pixels, steps))
        return self._along

    def _masks(self) -> Iterator[np.ndarray]:
        photos = self._bank.alpha.split(np.diff(self._bank.first_pixel).tolist())
        for (width, height), alpha in zip(self._bank.size.tolist(), photos, strict=True):
            yield alpha.view(height, width).cpu().numpy() > 0.5

    def _leave_out(self, pixels: Tensor) -> None:
        self.left_out = pixels
        self._bank.leave_out(pixels)
