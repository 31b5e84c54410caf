"""Find the mask of a photo: beside it, or in a folder of masks beside it or its folders."""

import os
import re
from collections.abc import Iterable
from pathlib import Path

from .errors import CaptureError
from .picture_names import agreement, folders_of, pictures_below, pictures_in, plain, stem_of

FOLDERS = (
    ".mask", "masks", "mask", "mattes", "matte", "alpha", "mask_images", "masks_png", "segmentation",
    "segmentations", "silhouette", "silhouettes",
)  # fmt: skip
ENDINGS = ("_masks", "_mask")
"""of a folder's name, after that of the photos' folder beside it"""
NAMES = ("{}_mask", "{}.mask", "{}-mask", "{}_masked", "mask_{}")
"""what masks are called besides their photos' names"""
_BESIDE = re.compile(r"(.+)[._-]mask|mask_(.+)")


def photos_of(folder: Path) -> tuple[str, ...] | None:
    """The folder of photos, by name, that a folder beside it has masks of; empty if that is any, None if
    it is no folder of masks."""
    name = folder.name.lower()
    if name in FOLDERS:
        return ()
    for ending in ENDINGS:
        photos = folder.name[: -len(ending)]
        if name.endswith(ending) and photos and (folder.parent / photos).is_dir():
            return (photos,)
    return None


def has_masks(folder: Path) -> bool:
    """True for a folder of masks, or of smaller copies beside it, such as `masks_2` beside `masks`."""
    whole = folder.with_name(re.sub(r"(?<=.)_\d{1,2}$", "", folder.name))
    return any(photos_of(f) is not None for f in {folder, whole} if f == folder or f.is_dir())


def masks_among(pictures: Iterable[Path]) -> list[Path]:
    """Those of some pictures that are masks of others in their folder: a_mask.png or a.jpg.mask.png of
    a.jpg."""
    stems = {picture: stem_of(picture.name) for picture in pictures}
    named = {(path.parent, name) for path in stems for name in (plain(path.name), stems[path])}
    found = ((path, _BESIDE.fullmatch(stem)) for path, stem in stems.items())
    return [path for path, form in found if form and (path.parent, form[1] or form[2]) in named]


def none_fits(masks: Path, photo: str, field: str = "masks") -> CaptureError:
    """The error that a folder of masks has none of any photo, such as `photo`.

    Args:
        field: what the folder was given as.
    """
    return CaptureError(
        masks, field, "no mask there has a photo's name",
        f"name masks like the photos, such as {Path(photo).stem}.png",
    )  # fmt: skip


def other_shape(path: Path, field: str, size: tuple[int, int], photo: tuple[int, int]) -> CaptureError:
    """The error that a mask of `size` (width, height) is of another shape than its photo."""
    return CaptureError(
        path, field, f"the mask is {size[0]} × {size[1]} pixels, its photo {photo[0]} × {photo[1]}",
        "export both in the same shape",
    )  # fmt: skip


class MaskFinder:
    """Masks by their photos.

    Args:
        folder: the capture's; masks are looked for nowhere else.
        masks: the only folder of masks; None: all that are named as such.
    """

    def __init__(self, folder: Path, masks: Path | None):
        self.folder, self.masks = folder, masks
        self._looked: set[Path] = set()
        self._by_name: dict[str, list[tuple[list[str], Path]]] = {}
        if masks is not None:
            self._add(masks, ())

    def of(self, photo: Path) -> Path | None:
        """The mask of a photo; of several with its name, the one in folders of the same names.

        Raises:
            CaptureError: several fit equally well.
        """
        self._look_beside(photo)
        stem, told = stem_of(photo.name), folders_of(self._inner(photo))
        whole = plain(photo.name)
        for name in (whole, stem, f"{whole}.mask", *(form.format(stem) for form in NAMES)):
            found = [
                (agreement(inner, told), mask)
                for inner, mask in self._by_name.get(name, []) if mask != photo
            ]  # fmt: skip
            if not found:
                continue
            best = max(fit for fit, _ in found)
            fitting = sorted(mask for fit, mask in found if fit == best)
            if len({mask.parent for mask in fitting}) > 1:
                raise CaptureError(
                    photo, "mask", f"'{fitting[0]}' and '{fitting[-1]}' could both be meant",
                    "remove one of them, or give the folder of the masks",
                )  # fmt: skip
            return fitting[0]
        return None

    def first(self) -> Path | None:
        """A mask, if there were any where masks were looked for."""
        return next((mask for found in self._by_name.values() for _, mask in found), None)

    def _look_beside(self, photo: Path) -> None:
        """Take in the masks and folders of masks beside a photo and beside its folders, once each."""
        if self.masks is not None or not photo.is_relative_to(self.folder):
            return
        for place in photo.parents:
            if place in self._looked or not place.is_relative_to(self.folder):
                break  # then those above were looked at, too
            self._looked.add(place)
            for mask in masks_among(pictures_in(place)):
                self._take_in(mask, folders_of(mask.relative_to(self.folder).parts))
            for beside in _folders_in(place):
                of = photos_of(beside)
                if of is not None:
                    self._add(beside, (*place.relative_to(self.folder).parts, *of))

    def _add(self, folder: Path, place: tuple[str, ...]) -> None:
        """Take in a folder of masks of the photos at a place in the capture's folder."""
        for path in pictures_below(folder):
            self._take_in(path, folders_of((*place, *path.relative_to(folder).parts)))

    def _take_in(self, mask: Path, inner: list[str]) -> None:
        for name in {plain(mask.name), plain(mask.stem), stem_of(mask.stem)}:
            self._by_name.setdefault(name, []).append((inner, mask))

    def _inner(self, path: Path) -> tuple[str, ...]:
        inside = path.is_relative_to(self.folder)
        return (path.relative_to(self.folder) if inside else path).parts


def _folders_in(folder: Path) -> list[Path]:
    try:
        with os.scandir(folder) as entries:
            return sorted(Path(entry.path) for entry in entries if entry.is_dir())
    except OSError:
        return []
