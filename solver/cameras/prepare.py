"""Photos as features are sought in them: turned as for a fit, reduced, grey, without what is not to be
looked at."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image
from scipy import ndimage

from ..capture.camera import Camera
from ..capture.image_header import image_orientation, image_size
from ..capture.mask_finder import none_fits, other_shape
from ..capture.orientation import same_shape
from ..capture.photo_finder import PhotoFinder
from ..capture.reduced import load_reduced, load_reduced_mask, read_header
from ..capture.told import told_of_reduced

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
        mask, ignored: as `Camera.mask_path` and `Camera.ignored_path`.
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
    ignored: Path | None

    @property
    def file(self) -> str:
        """Name in the database: free of blanks, which COLMAP's lists of pairs cannot hold."""
        return f"{self.number:06d}.png"

    @property
    def lens_key(self) -> tuple:
        """Photos with one key were probably taken with one lens."""
        return (self.width, self.height, None if self.focal is None else round(self.focal))


def look_at(
    folder: Path, names: tuple[str, ...], masks: Path | None, longest: int, ignored: Path | None = None
) -> list[Prepared]:
    """Read the headers of all photos.

    Args:
        ignored: see `IgnoredFinder`.

    Raises:
        CaptureError: one is no picture; its mask, or what is to be ignored of it, is of another shape; or
            `ignored` fits none.
    """
    finder = PhotoFinder(folder, masks, ignored=ignored)
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
                number, name, path, header.width, header.height, *small, header.focal, mask,
                finder.ignored.of(path),
            )
        )  # fmt: skip
        _check_shape(found[-1], "mask")
        _check_shape(found[-1], "ignored")
    if ignored is not None and not any(photo.ignored for photo in found):
        raise none_fits(ignored, names[0], "ignore")
    return found


def _check_shape(photo: Prepared, name: str) -> None:
    """Make sure that the picture of a photo that an attribute names, if there is one, is of its shape."""
    path = getattr(photo, name)
    if path is None:
        return
    size, wanted = image_size(path), (photo.width, photo.height)
    turned = max(map(image_orientation, (path, photo.path))) >= 5
    if not any(same_shape(s, wanted) for s in ((size, size[::-1]) if turned else (size,))):
        raise other_shape(path, f"{name}_path", size, wanted)


def write_prepared(photo: Prepared, pictures: Path, masks: Path) -> None:
    """Write the grey picture, and its mask if it has one (alpha, a mask file, or what is to be ignored).

    Raises:
        CaptureError: it cannot be decoded, or all of it is to be ignored.
    """
    size = (photo.small_width, photo.small_height)
    # Turned as a fit turns it, which leaves half turns as they lie.
    colour, alpha = load_reduced(photo.path, max(size), (photo.width, photo.height))
    shown = None if alpha is None or alpha.min() == 255 else _resized(alpha, size)
    if photo.mask is not None:
        mask = load_reduced_mask(
            photo.mask, size[::-1], (photo.width, photo.height), image_orientation(photo.path)
        )
        shown = mask if shown is None else np.minimum(shown, mask)
    told = told_of_reduced(_seen(photo), size[::-1])
    if told is not None:
        shown = np.uint8(255) * told if shown is None else shown * told
    grey = _resized(np.asarray(Image.fromarray(np.ascontiguousarray(colour)).convert("L")), size)
    if shown is not None:
        inside = ndimage.minimum_filter(shown > 127, 2 * _BORDER + 1)
        _save(inside.astype(np.uint8) * 255, masks / f"{photo.file}.png")
    _save(grey, pictures / photo.file)


def _seen(photo: Prepared) -> Camera:
    """A camera of the photo, whose place and lens are yet to be found."""
    focal = float(max(photo.width, photo.height))
    return Camera(
        photo.name, photo.path, np.eye(4), photo.width, photo.height, focal, focal,
        photo.width / 2, photo.height / 2, ignored_path=photo.ignored,
    )  # fmt: skip


def _resized(pixels: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    picture = Image.fromarray(np.ascontiguousarray(pixels))
    enlarged = size[0] > picture.width
    filtered = Image.Resampling.BICUBIC if enlarged else Image.Resampling.BOX
    return np.asarray(picture.resize(size, filtered))


def _save(pixels: np.ndarray, path: Path) -> None:
    Image.fromarray(np.ascontiguousarray(pixels)).save(path, compress_level=1)
