"""Find the photos and masks that a camera file names: below the capture's folder, and nowhere else.

Camera files name photos by paths of the machine they were made on. Here a name counts by how much of
its end fits a picture's path below the folder, so a project that moved is read as it is; and a file
that names /etc/passwd gets nothing.
"""

from __future__ import annotations

import os
import re
import unicodedata
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath

from .errors import CaptureError, shown
from .image_header import EXTENSIONS

MODEL_FOLDERS = re.compile(
    r"sparse|dense|distorted|bundle|models?|colmap|text|bin|(corrected_)?cameras?|sfm|reconstruction|\d+",
    re.I,
)
"""folders that hold a solved model beside its photos, never photos alone"""
MASK_FOLDERS = ("masks", "mask", "mattes", "matte", "alpha")
MASK_ENDINGS = ("_masks", "_mask")
"""of a folder's name, after that of the photos' folder beside it"""
MASK_NAMES = ("{}_mask", "{}.mask", "{}-mask", "{}_masked", "mask_{}")
"""what masks are called besides their photos' names"""
UNREADABLE = (".heic", ".heif", ".webp", ".avif", ".bmp", ".dng", ".cr2", ".cr3", ".nef", ".arw")
"""extensions of photos that cannot be read here, but may have been converted since"""
DEEPEST, MOST_FILES = 6, 200_000


def capture_folder(file: Path) -> Path:
    """The folder that a camera file and its photos share: `project` for `project/sparse/0/images.bin`."""
    folder = file.parent
    for _ in range(3):
        if not MODEL_FOLDERS.fullmatch(folder.name) or _pictures_in(folder):
            break
        folder = folder.parent
    return folder


class PhotoFinder:
    """Pictures below a folder, by what a camera file calls them.

    Args:
        folder: nothing outside it is found.
        masks: a folder of masks; None: all folders below `folder` that are named as such.
        anywhere: names may be absolute paths to anywhere; only for files this program wrote.
    """

    def __init__(self, folder: Path, masks: Path | None = None, anywhere: bool = False):
        self.folder = Path(os.path.normpath(folder.absolute()))
        self.mask_folder = None if masks is None else Path(os.path.normpath(masks.absolute()))
        self.anywhere = anywhere
        self._by_stem: dict[str, list[Path]] | None = None
        self._folders: set[tuple[str, ...]] = set()
        self._masks: dict[str, list[tuple[list[str], Path]]] | None = None

    def find(self, stated: str, beside: Path | None = None) -> Path | None:
        """The photo that a file calls `stated` (a path or a name, with or without extension).

        A photo that is not in the folder where it should be is missing, whatever other folders have.

        Args:
            beside: the camera file, if its names are relative to its folder.

        Raises:
            CaptureError: several pictures fit equally well.
        """
        stated = stated.strip()
        if not stated or "\0" in stated:
            return None
        for base in ([] if beside is None else [beside.parent]) + [self.folder]:
            if (found := self._at(base, stated)) is not None:
                return found
        parts = _parts(stated)
        if not parts:
            return None
        candidates = self._pictures().get(_stem(parts[-1]), [])
        best = sorted(((self._fit(path, parts), path) for path in candidates), reverse=True)
        if not best:
            return None
        told = _folders(parts)
        if max(_agreement(folders, told) for folders in self._folders) > best[0][0][0]:
            return None
        if len(best) > 1 and best[0][0] == best[1][0]:
            raise self._unclear(stated, best[0][1], best[1][1], "the photos")
        return best[0][1]

    def unreadable(self, stated: str) -> Path | None:
        """A photo of that name in a format that cannot be read."""
        parts = _parts(stated)
        if not parts or not self.folder.is_dir():
            return None
        stem = _stem(parts[-1])
        there = _walk(self.folder, UNREADABLE)
        return next((path for path in there if _stem(path.name) == stem), None)

    def _unclear(self, name: str, one: Path, other: Path, what: str) -> CaptureError:
        one, other = (
            path.relative_to(self.folder) if path.is_relative_to(self.folder) else path
            for path in (one, other)
        )
        return CaptureError(
            self.folder, shown(name), f"'{one}' and '{other}' could both be meant",
            f"leave one of them in the folder, or give the folder of {what}",
        )  # fmt: skip

    def find_in(self, folder: Path, name: str) -> Path | None:
        """The photo `name` of just that folder; if the folder is not there, as `find` has it.

        For captures whose depth maps bear the photos' names.
        """
        folder = Path(os.path.normpath(folder.absolute()))
        if folder.is_dir() and folder.is_relative_to(self.folder):
            return self._at(folder, name)
        return self.find(f"{folder.name}/{name}")

    def mask_of(
        self, photo: Path, stated: object = None, beside: Path | None = None
    ) -> Path | None:
        """The mask of a photo: the one the camera file names, else one of its name in a mask folder."""
        if isinstance(stated, str) and stated:
            base = self.folder if beside is None else beside.parent
            found = self._at(base, stated) or self._at(self.folder, stated)
            return found if found is not None else base.joinpath(*_parts(stated))
        masks, stem = self._all_masks(), _stem(photo.name)
        told = _folders(self._inner(photo))
        for name in (photo.name, stem, *(form.format(stem) for form in MASK_NAMES)):
            found = [(_agreement(inner, told), mask) for inner, mask in masks.get(_plain(name), [])]
            best = sorted((entry for entry in found if entry[1] != photo), reverse=True)
            if (
                len(best) > 1
                and best[0][0] == best[1][0]
                and best[0][1].parent != best[1][1].parent
            ):
                raise self._unclear(photo.name, best[0][1], best[1][1], "the masks")
            if best:
                return best[0][1]
        return None

    def unused_masks(self) -> Path | None:
        """A mask, if there are any: for where no photo has one."""
        return next((mask for found in self._all_masks().values() for _, mask in found), None)

    def pictures(self) -> list[Path]:
        """All pictures below the folder that are no masks, in the order of their paths."""
        return sorted(path for paths in self._pictures().values() for path in paths)

    def _at(self, base: Path, stated: str) -> Path | None:
        """A picture at just that path, if it lies where pictures may be read."""
        stated = stated.replace("\\", "/") if "\\" in stated and os.sep == "/" else stated
        try:
            path = Path(os.path.normpath(base / stated))
            if not self.anywhere and not path.is_relative_to(self.folder):
                return None
            named = [path] if path.suffix.lower() in EXTENSIONS else []
            for candidate in named + [path.with_name(path.name + e) for e in EXTENSIONS]:
                if candidate.is_file():
                    return candidate
        except (OSError, ValueError):
            pass
        return None

    def _pictures(self) -> dict[str, list[Path]]:
        """Pictures by the plain stem of their names."""
        if self._by_stem is None:
            self._sort()
        return self._by_stem

    def _all_masks(self) -> dict[str, list[tuple[list[str], Path]]]:
        """Masks with their folders, as they would be if they were photos, by their plain names with and
        without extensions."""
        if self._masks is None:
            self._sort()
        return self._masks

    def _sort(self) -> None:
        """Tell photos and masks below the folder apart, by the folders they are in."""
        self._by_stem, self._masks = {}, {}
        for path in _walk(self.folder):
            inner = self._inner(path)
            if self.mask_folder is not None and path.is_relative_to(self.mask_folder):
                continue
            without = [self._without_mask(path, depth) for depth in range(len(inner) - 1)]
            if without != inner[:-1]:
                if self.mask_folder is None:
                    self._add_mask(path, _folders([*filter(None, without), path.name]))
                continue
            self._by_stem.setdefault(_stem(path.name), []).append(path)
            self._folders.add(tuple(_folders(inner)))
        for path in () if self.mask_folder is None else _walk(self.mask_folder):
            self._add_mask(path, _folders(list(path.relative_to(self.mask_folder).parts)))

    def _add_mask(self, path: Path, folders: list[str]) -> None:
        for name in {path.name, path.stem, _stem(path.stem)}:
            self._masks.setdefault(_plain(name), []).append((folders, path))

    def _inner(self, path: Path) -> list[str]:
        """A path's parts below the folder; of one elsewhere, all."""
        inside = path.is_relative_to(self.folder)
        return list((path.relative_to(self.folder) if inside else path).parts)

    def _without_mask(self, path: Path, depth: int) -> str:
        """What the folder at a depth of the path would be called for photos; nothing for `masks`."""
        inner = self._inner(path)
        name = inner[depth].lower()
        if name in MASK_FOLDERS:
            return ""
        for ending in MASK_ENDINGS:
            photos = inner[depth][: -len(ending)]
            if name.endswith(ending) and (self.folder.joinpath(*inner[:depth]) / photos).is_dir():
                return photos
        return inner[depth]

    def _fit(self, path: Path, parts: list[str]) -> tuple[int, int]:
        """How many of the last folders agree, and whether the extension does."""
        own = self._inner(path)
        same_name = _plain(own[-1]) == _plain(parts[-1])
        return _agreement(_folders(own), _folders(parts)), int(same_name)


def _folders(parts: list[str]) -> list[str]:
    """The plain names of the folders of a path."""
    return [_plain(part) for part in parts[:-1]]


def _agreement(one: Sequence[str], other: Sequence[str]) -> int:
    """How many of the last folders of two paths are the same."""
    count = 0
    for a, b in zip(reversed(one), reversed(other), strict=False):
        if a != b:
            break
        count += 1
    return count


def _parts(stated: str) -> list[str]:
    parts = PurePosixPath(stated.replace("\\", "/")).parts
    return [part for part in parts if part not in (".", "..", "/")]


def _stem(name: str) -> str:
    """A file's plain name without a picture's extension."""
    name = _plain(name)
    for extension in EXTENSIONS + UNREADABLE:
        if name.endswith(extension):
            return name[: -len(extension)]
    return name


def _plain(name: str) -> str:
    """A name in lower case and one spelling: systems write letters with marks in two ways."""
    return unicodedata.normalize("NFC", name).lower()


def _pictures_in(folder: Path) -> bool:
    try:
        return any(p.suffix.lower() in EXTENSIONS for p in folder.iterdir())
    except OSError:
        return False


def _walk(folder: Path, extensions: tuple[str, ...] = EXTENSIONS) -> Iterator[Path]:
    """Pictures below a folder, not deeper than `DEEPEST`; links to folders are not followed."""
    start, seen = len(folder.parts), 0
    for place, folders, files in os.walk(folder):
        if len(Path(place).parts) - start >= DEEPEST:
            folders.clear()
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(files):
            seen += 1
            if seen > MOST_FILES:
                return
            if Path(name).suffix.lower() in extensions and not name.startswith("."):
                yield Path(place) / name
