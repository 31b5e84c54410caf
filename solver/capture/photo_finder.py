"""Find the photos and masks that a camera file names: below the capture's folder, and nowhere else.

Camera files name photos by paths of the machine they were made on. Here a name counts by how much of
its end fits a picture's path below the folder, so a project that moved is read as it is; and a file
that names /etc/passwd gets nothing.
"""

import os
import re
from contextlib import suppress
from pathlib import Path
from urllib.parse import unquote

from .errors import CaptureError, shown
from .ignored import IgnoredFinder, beside_among
from .image_header import EXTENSIONS, developed
from .mask_finder import MaskFinder, has_masks, masks_among
from .picture_names import (
    UNREADABLE,
    agreement,
    folders_of,
    largest_copy,
    parts_of,
    pictures_below,
    pictures_in,
    plain,
    stem_of,
)

MIN_PHOTOS = 3
"""of a reconstruction"""
MODEL_FOLDERS = re.compile(
    r"sparse|dense|distorted|bundle|models?|colmap|text|bin|(corrected_)?cameras?|cams(_\w+)?|poses?|intrinsics?|extrinsic|cam_in_ob|ob_in_cam|(open)?sfm|matches|params|1_initial|reconstruction(_\w+)?|calibration|cal\d+|\d+",
    re.I,
)
"""folders that hold a solved model beside its photos, never photos alone"""
_SPLIT = re.compile(r"(train|test|val)(ing|idation)?(_?(images?|imgs?|photos?|rgb|\d+))?")
_PHOTOS = re.compile(r"(corrected_)?(images?|imgs?|photos?|frames?|rgb|colou?r)(_\d{1,2})?")
_MAPS = re.compile(r"((mono|omnidata|gt)_)?(depths?|normals?|confidence)(_?maps?)?(_\d{1,2})?")
"""folders of photos by their use, of photos, and of maps beside them, which are called as they are"""

CODE_PAGES = (
    "cp1252", "cp1250", "cp1251", "cp1253", "cp1254", "cp932", "cp936", "cp949", "cp950",
    "mac_roman",
)  # fmt: skip
"""encodings in which programs on Windows, COLMAP among them, and Excel write names of photos"""


def capture_folder(file: Path) -> Path:
    """The folder that a camera file and its photos share: `project` for `project/sparse/0/images.bin`."""
    folder = file.parent
    for _ in range(3):
        if not MODEL_FOLDERS.fullmatch(folder.name) or pictures_in(folder):
            break
        folder = folder.parent
    return folder


def folder_with_photos(file: Path) -> Path:
    """The folder nearest a camera file, on the way to `capture_folder`, with pictures below it; that one,
    if there is none."""
    last, folder = capture_folder(file), file.parent
    while folder != last and not any(pictures_below(folder)):
        folder = folder.parent
    return Path(os.path.abspath(folder))


class PhotoFinder:
    """Pictures below a folder, by what a camera file calls them.

    Args:
        folder: nothing outside it is found.
        masks: a folder of masks; None: all folders below `folder` that are named as such.
        anywhere: names may be absolute paths to anywhere; only for files this program wrote.
        fewest: photos that are of use together.
        wanted: cameras are of use only with their photos; else for pictures that are to be made, and
            there may be none, or several that could be meant.
        ignored: see `IgnoredFinder`.
    """

    def __init__(
        self, folder: Path, masks: Path | None = None, anywhere: bool = False,
        fewest: int = MIN_PHOTOS, wanted: bool = True, ignored: Path | None = None,
    ):  # fmt: skip
        self.folder = Path(os.path.abspath(folder))
        self.masks = MaskFinder(self.folder, None if masks is None else Path(os.path.abspath(masks)))
        if ignored is not None:
            ignored = Path(os.path.abspath(ignored))
        self.ignored = IgnoredFinder(self.folder, ignored)
        self.anywhere = anywhere
        self.fewest, self.wanted = fewest, wanted
        self._by_stem: dict[str, list[Path]] | None = None
        self._folders: set[tuple[str, ...]] = set()
        self._of_masks: dict[Path, bool] = {}
        # In folders: to ask for one with each extension takes long.
        self._names: dict[Path, dict[str, str] | None] = {}

    def find(self, stated: str, beside: Path | None = None) -> Path | None:
        """The photo that a file calls `stated` (a path or a name, with or without extension).

        Args:
            beside: the camera file, if its names are relative to its folder.

        Raises:
            CaptureError: several pictures fit equally well, and they are wanted.
        """
        stated = self._readable(stated.strip())
        if not stated or "\0" in stated:
            return None
        for base in ([] if beside is None else [beside.parent]) + [self.folder]:
            if (found := self._at(base, stated)) is not None:
                return found if self.anywhere else self._developed(found)
        parts = parts_of(stated)
        if not parts:
            return None
        candidates = [
            path
            for path in self._pictures().get(stem_of(parts[-1]), [])
            if not _is_of_other_use(folders_of(path.relative_to(self.folder).parts), folders_of(parts))
        ]
        best = sorted(((self._fit(path, parts), path) for path in candidates), reverse=True)
        if not best:
            # Some programs write names as addresses of the web have them.
            decoded = unquote(stated.removeprefix("file://"))
            return None if decoded == stated else self.find(decoded, beside)
        if len(best) > 1 and best[0][0] == best[1][0]:
            told = folders_of(parts)
            if max(agreement(folders, told) for folders in self._folders) > best[0][0][0]:
                return None  # these are copies; it is missing from the folder where it should be
            tied = [path for fit, path in best if fit == best[0][0]]
            if len({path.resolve() for path in tied}) == 1:
                return min(tied, key=lambda path: path.is_symlink())  # the others are links to it
            largest = largest_copy(tied)
            if largest is not None or not self.wanted:
                return largest
            raise CaptureError(
                self.folder, shown(stated), f"'{best[0][1].relative_to(self.folder)}' and "
                f"'{best[1][1].relative_to(self.folder)}' could both be meant",
                "leave one of them in the folder, or give the folder of the photos",
            )  # fmt: skip
        return best[0][1]

    def _readable(self, stated: str) -> str:
        """A name; one that is no UTF-8 in the encoding in which a picture's path fits it best."""
        readings = [stated]
        try:
            stated.encode("utf-8")
        except UnicodeEncodeError:
            for page in CODE_PAGES:
                with suppress(UnicodeError):
                    readings.append(stated.encode("utf-8", "surrogateescape").decode(page))
        return max(readings, key=self._folders_that_fit) if len(readings) > 1 else stated

    def _folders_that_fit(self, stated: str) -> int:
        """How many of the last folders a picture of that name has in common with it; -1: there is none."""
        parts = parts_of(stated)
        named = self._pictures().get(stem_of(parts[-1]), []) if parts else []
        told = folders_of(parts)
        own = (folders_of(path.relative_to(self.folder).parts) for path in named)
        return max((agreement(folders, told) for folders in own), default=-1)

    def serves(self, photo: Path | None) -> bool:
        """True if a camera with this photo, or with none, is of use."""
        return photo is not None or not self.wanted

    def unreadable(self, stated: str) -> Path | None:
        """A photo of that name in a format that cannot be read."""
        parts = parts_of(stated)
        if not parts or not self.folder.is_dir():
            return None
        stem = stem_of(parts[-1])
        there = pictures_below(self.folder, UNREADABLE)
        return next((path for path in there if stem_of(path.name) == stem), None)

    def find_in(self, folder: Path, name: str) -> Path | None:
        """The photo `name` of just that folder; if the folder is not there, as `find` has it.

        For captures whose depth maps bear the photos' names.
        """
        folder = Path(os.path.abspath(folder))
        if folder.is_dir() and folder.is_relative_to(self.folder):
            beside = (p for p in self._pictures().get(stem_of(name), []) if p.parent == folder)
            return self._at(folder, name) or next(beside, None)
        return self.find(f"{folder.name}/{name}")

    def mask_of(self, photo: Path, stated: object = None, beside: Path | None = None) -> Path | None:
        """The mask of a photo: the one the camera file names, else one of its name in a mask folder."""
        if isinstance(stated, str) and stated:
            base = self.folder if beside is None else beside.parent
            found = self._at(base, stated) or self._at(self.folder, stated)
            return found or self.masks.of(photo) or _missing_in(base, stated)
        return self.masks.of(photo)

    def picture_at(self, stated: object, beside: Path) -> Path | None:
        """The picture that a camera file names, by the path from its folder or the capture's; where it
        would be, if it is not there; None: it names none."""
        if not isinstance(stated, str) or not stated:
            return None
        found = self._at(beside.parent, stated) or self._at(self.folder, stated)
        return found or _missing_in(beside.parent, stated)

    def pictures(self) -> list[Path]:
        """All pictures below the folder that are no masks, in the order of their paths."""
        return sorted(path for paths in self._pictures().values() for path in paths)

    def _at(self, base: Path, stated: str) -> Path | None:
        """A picture at just that path, if it lies where pictures may be read."""
        stated = stated.replace("\\", "/") if "\\" in stated and os.sep == "/" else stated
        with suppress(OSError, ValueError):
            path = Path(os.path.normpath(base / stated))
            if not self.anywhere and not path.is_relative_to(self.folder):
                return None
            there = self._listed(path.parent)
            for ending in ("", *EXTENSIONS):
                name = path.name + ending
                listed = name if there is None else there.get(name) or there.get(plain(name), "")
                # As it is called, also on a disk that takes letters of either case for the same.
                if listed.lower().endswith(EXTENSIONS) and path.with_name(name).is_file():
                    return path.with_name(listed)
        return None

    def _listed(self, folder: Path) -> dict[str, str] | None:
        """The names in a folder, by themselves and plain; None where one may enter but not list it."""
        if folder not in self._names:
            try:
                names = os.listdir(folder)
                self._names[folder] = {plain(name): name for name in names} | {n: n for n in names}
            except PermissionError:
                self._names[folder] = None
        return self._names[folder]

    def _developed(self, photo: Path) -> Path:
        """The copy of a raw photo that lies beside it, if there is one: developed as its owner would have
        it; else the photo itself."""
        if developed(photo) > 0:
            return photo
        beside = (p for p in self._pictures().get(stem_of(photo.name), []) if p.parent == photo.parent)
        return max(beside, key=developed, default=photo)

    def _pictures(self) -> dict[str, list[Path]]:
        """Pictures that are no masks by the plain stem of their names; of a raw photo, a HEIC or AVIF and
        its copy in the same folder, the copy."""
        if self._by_stem is None:
            self._by_stem = {}
            found = [p for p in pictures_below(self.folder) if not self._is_mask(p.parent)]
            masks = {*masks_among(found), *beside_among(found), self.ignored.given}
            furthest: dict[tuple[Path, str], int] = {}
            for path in found:
                key = path.parent, stem_of(path.name)
                furthest[key] = max(developed(path), furthest.get(key, 0))
            for path in found:
                has_copy = developed(path) < furthest[path.parent, stem_of(path.name)]
                if path not in masks and not has_copy:
                    self._by_stem.setdefault(stem_of(path.name), []).append(path)
                    self._folders.add(tuple(folders_of(path.relative_to(self.folder).parts)))
        return self._by_stem

    def _is_mask(self, folder: Path) -> bool:
        """True for a folder in the capture's with masks, or with pictures of what is to be ignored."""
        if folder in (self.folder, self.masks.masks, self.ignored.folder):
            return folder != self.folder
        if folder not in self._of_masks:
            self._of_masks[folder] = has_masks(folder) or self._is_mask(folder.parent)
        return self._of_masks[folder]

    def _fit(self, path: Path, parts: list[str]) -> tuple[int, int, int]:
        """How many of the last folders agree, whether the extension does, and how far it is developed:
        cameras are mostly solved with copies of raw photos, HEIC and AVIF."""
        own = path.relative_to(self.folder).parts
        same_name = plain(own[-1]) == plain(parts[-1])
        return agreement(folders_of(own), folders_of(parts)), int(same_name), developed(path)


def _is_of_other_use(own: list[str], told: list[str]) -> bool:
    """True if a picture's last folder is of another split than a file tells, or of maps beside photos."""
    same = agreement(own, told)
    own_last, told_last = (["", *folders[: len(folders) - same]][-1] for folders in (own, told))
    splits = {found[1] for found in map(_SPLIT.fullmatch, (own_last, told_last)) if found}
    return len(splits) == 2 or bool(_PHOTOS.fullmatch(told_last) and _MAPS.fullmatch(own_last))


def _missing_in(folder: Path, stated: str) -> Path:
    """Where in a folder a picture would be that a file names and that is not there: for the error that says
    so, and never outside of the folder, as a name with a drive of Windows in its midst would be."""
    folder = Path(os.path.normpath(folder))
    path = Path(os.path.normpath(folder.joinpath(*parts_of(stated))))
    return path if path.is_relative_to(folder) else folder / "mask"
