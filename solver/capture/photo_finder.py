"""Find the photos and masks that a camera file names: below the capture's folder, and nowhere else.

Camera files name photos by paths of the machine they were made on. Here a name counts by how much of
its end fits a picture's path below the folder, so a project that moved is read as it is; and a file
that names /etc/passwd gets nothing.
"""

from __future__ import annotations

import os
import re
from pathlib import Path, PurePosixPath

from .errors import CaptureError, shown
from .image_header import EXTENSIONS

MODEL_FOLDERS = re.compile(
    r"sparse|dense|distorted|bundle|models?|colmap|text|bin|(corrected_)?cameras?|sfm|reconstruction|\d+",
    re.I,
)
"""folders that hold a solved model beside its photos, never photos alone"""
MASK_FOLDERS = ("masks", "mask", "mattes", "matte", "alpha")
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
        masks: a folder of masks; None: one of `MASK_FOLDERS` below `folder`, if there.
        anywhere: names may be absolute paths to anywhere; only for files this program wrote.
    """

    def __init__(self, folder: Path, masks: Path | None = None, anywhere: bool = False):
        self.folder = Path(os.path.normpath(folder.absolute()))
        self.mask_folder = None if masks is None else Path(os.path.normpath(masks.absolute()))
        self.anywhere = anywhere
        self._by_stem: dict[str, list[Path]] | None = None
        self._masks: dict[str, Path] | None = None

    def find(self, stated: str, beside: Path | None = None) -> Path | None:
        """The photo that a file calls `stated` (a path or a name, with or without extension).

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
        if len(best) > 1 and best[0][0] == best[1][0]:
            raise CaptureError(
                self.folder, shown(stated), f"'{best[0][1].relative_to(self.folder)}' and "
                f"'{best[1][1].relative_to(self.folder)}' could both be meant",
                "leave one of them in the folder, or give the folder of the photos",
            )  # fmt: skip
        return best[0][1] if best else None

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
            return found if found is not None else base / _parts(stated)[-1]
        masks = self._all_masks()
        for name in (photo.name, photo.stem, f"{photo.stem}_mask", f"{photo.stem}.mask"):
            if (mask := masks.get(name.lower())) is not None and mask != photo:
                return mask
        return None

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
        """Pictures by the lower-case stem of their names."""
        if self._by_stem is None:
            self._by_stem = {}
            for path in _walk(self.folder):
                inner = [part.lower() for part in path.relative_to(self.folder).parts[:-1]]
                is_mask = any(part in MASK_FOLDERS for part in inner)
                if not is_mask and not path.is_relative_to(self.mask_folder or "\0"):
                    self._by_stem.setdefault(_stem(path.name), []).append(path)
        return self._by_stem

    def _all_masks(self) -> dict[str, Path]:
        """Masks by their lower-case names, with and without extensions."""
        if self._masks is None:
            folders = [self.mask_folder] if self.mask_folder else []
            if not folders and self.folder.is_dir():
                named = (p for p in self.folder.iterdir() if p.name.lower() in MASK_FOLDERS)
                folders = sorted(path for path in named if path.is_dir())
            self._masks = {}
            for path in (p for folder in folders[:1] for p in _walk(folder)):
                for name in (path.name, path.stem, Path(path.stem).stem):
                    self._masks.setdefault(name.lower(), path)
        return self._masks

    def _fit(self, path: Path, parts: list[str]) -> tuple[int, int]:
        """How many of the last folders agree, and whether the extension does."""
        own = [part.lower() for part in path.relative_to(self.folder).parts]
        told = [part.lower() for part in parts]
        same_name = own[-1] == told[-1]
        count = 0
        for a, b in zip(reversed(own[:-1]), reversed(told[:-1]), strict=False):
            if a != b:
                break
            count += 1
        return count, int(same_name)


def _parts(stated: str) -> list[str]:
    parts = PurePosixPath(stated.replace("\\", "/")).parts
    return [part for part in parts if part not in (".", "..", "/")]


def _stem(name: str) -> str:
    """A file's name in lower case, without a picture's extension."""
    name = name.lower()
    for extension in EXTENSIONS:
        if name.endswith(extension):
            return name[: -len(extension)]
    return name


def _pictures_in(folder: Path) -> bool:
    try:
        return any(p.suffix.lower() in EXTENSIONS for p in folder.iterdir())
    except OSError:
        return False


def _walk(folder: Path):
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
            if Path(name).suffix.lower() in EXTENSIONS and not name.startswith("."):
                yield Path(place) / name
