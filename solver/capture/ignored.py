"""Find the picture of what is to be ignored of a photo (`Camera.ignored_path`).

instant-ngp looks for `dynamic_mask_a.png` beside `a.jpg`, and does not fit what is not black in it
(`nerf_loader.cu`). All others a person names: a folder of pictures that are called as masks would be, or
one picture for all photos, as of a lens's corners or of what a drone always has before it. They are white
where there is nothing to be fitted.
"""

from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from .errors import CaptureError
from .image_header import UnknownSize, image_size
from .mask_finder import MaskFinder
from .picture_names import plain, stem_of

BESIDE = "dynamic_mask_{}.png"
"""as instant-ngp names it, after its photo's name without the extension"""
_BEFORE = BESIDE.partition("{}")[0]


def beside_among(pictures: Iterable[Path]) -> set[Path]:
    """Those of some pictures that are of what is to be ignored of others in their folder."""
    pictures = list(pictures)
    named = {(path.parent, stem_of(path.name)) for path in pictures}
    return {
        path
        for path in pictures
        if plain(path.name).startswith(_BEFORE)
        and (path.parent, stem_of(path.name).removeprefix(_BEFORE)) in named
    }


def check_given(photos: Path | None, masks: Path | None, ignored: Path | None) -> None:
    """Make sure that what a person gave is there, before a job is made.

    Raises:
        CaptureError: there is no such folder, or no such picture.
    """
    for folder, what in ((photos, "photos"), (masks, "masks")):
        if folder is not None and not folder.is_dir():
            raise CaptureError(folder, what, "there is no such folder", "check its path")
    if ignored is not None and not ignored.exists():
        raise CaptureError(ignored, "ignore", "there is no such folder or picture", "check its path")
    if ignored is not None and ignored.is_file():
        with suppress(UnknownSize):
            image_size(ignored)


class IgnoredFinder:
    """Pictures of what is to be ignored, by their photos.

    Args:
        folder: the capture's.
        given: the only folder of such pictures, or the one of all photos; None: those beside the photos.
    """

    def __init__(self, folder: Path, given: Path | None):
        self.given = given
        self.of_all = given is not None and not given.is_dir()
        self._by_name = None
        if given is not None and not self.of_all:
            self._by_name = MaskFinder(folder, given)

    @property
    def folder(self) -> Path | None:
        """The folder of such pictures, in which there are no photos."""
        return None if self.of_all else self.given

    def of(self, photo: Path) -> Path | None:
        """The picture of what is to be ignored of a photo, if there is one.

        Raises:
            CaptureError: several fit equally well.
        """
        if self.of_all:
            return self.given
        if self._by_name is not None:
            return self._by_name.of(photo)
        beside = photo.with_name(BESIDE.format(photo.stem))
        return beside if beside.is_file() else None
