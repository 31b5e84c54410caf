"""Photos as features are sought in them: turned as for a fit, reduced, grey, without what is masked out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.ndimage
from PIL import Image

from ..capture.image_header import image_orientation
from ..capture.photo_finder import PhotoFinder
from ..capture.reduced import load_reduced, load_reduced_mask, read_header

SMALL, MOST_ENLARGED = 800, 4
"""longer side, in pixels, to which smaller photos are enlarged, and by how much at most: features have a
size in pixels below which none are found"""
_BORDER = 4
"""pixels inside a mask's edge where features would be the edge's, not the object's"""


@dataclass(frozen=True)
class Prepared:
    """A photo on its way to the database.

    Attributes:
        number: from 1; its name in the database is `file`.
        name: relative to the folder of photos.
        width, height: of the photo, upright.
        small_width, small_height: at which features are found.
        focal: pixels of the photo, if its header says; else None.
    """

    number: int
    name: str
    path: Path
    width: int
    height: int
    small_width: int
    small_height: int
    focal: float | None
    mask: Path | None

    @property
    def file(self) -> str:
        """Name in the database: free of blanks, which COLMAP's lists of pairs cannot hold."""
        return f"{self.number:06d}.png"

    @property
    def lens_key(self) -> tuple:
        """Photos with one key were probably taken with one lens."""
        return (self.width, self.height, None if self.focal is None else round(self.focal))


def look_at(
    folder: Path, names: tuple[str, ...], masks: Path | None, longest: int
) -> list[Prepared]:
    """Read the headers of all photos.

    Raises:
        CaptureError: one is no picture.
    """
    finder = PhotoFinder(folder, masks)
    found = []
    for number, name in enumerate(names, start=1):
        path = folder / name
        header = read_header(path)
        side = max(header.width, header.height)
        factor = min(longest / side, max(1.0, min(SMALL / side, MOST_ENLARGED)))
        small = [max(1, round(length * factor)) for length in (header.width, header.height)]
        mask = None if masks is None else finder.mask_of(path)
        found.append(
            Prepared(
                number, name, path, header.width, header.height, *small, header.focal, mask
            )
        )  # fmt: skip
    return found


def write_prepared(photo: Prepared, pictures: Path, masks: Path) -> None:
    """Write the grey picture, and its mask if it has one (alpha, or a mask file).

    Raises:
        CaptureError: it cannot be decoded.
    """
    size = (photo.small_width, photo.small_height)
    # Turned as a fit turns it, which leaves half turns as they lie.
    colour, alpha = load_reduced(photo.path, max(size), (photo.width, photo.height))
    shown = None if alpha is None or alpha.min() == 255 else _resized(alpha, size)
    if photo.mask is not None:
        mask = load_reduced_mask(photo.mask, size[::-1], image_orientation(photo.path))
        shown = mask if shown is None else np.minimum(shown, mask)
    grey = _resized(np.asarray(Image.fromarray(np.ascontiguousarray(colour)).convert("L")), size)
    if shown is not None:
        inside = scipy.ndimage.minimum_filter(shown > 127, 2 * _BORDER + 1)
        _save(inside.astype(np.uint8) * 255, masks / f"{photo.file}.png")
    _save(grey, pictures / photo.file)


def _resized(pixels: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    picture = Image.fromarray(np.ascontiguousarray(pixels))
    enlarged = size[0] > picture.width
    filtered = Image.Resampling.BICUBIC if enlarged else Image.Resampling.BOX
    return np.asarray(picture.resize(size, filtered))


def _save(pixels: np.ndarray, path: Path) -> None:
    Image.fromarray(np.ascontiguousarray(pixels)).save(path, compress_level=1)
