"""Names of pictures and their folders, as programs and systems spell them; and pictures below a folder."""

import os
import re
import unicodedata
from collections.abc import Iterator, Sequence
from pathlib import Path

from .errors import CaptureError
from .image_header import EXTENSIONS, image_size

UNREADABLE = (".bmp", ".gif", ".jxl", ".x3f", ".tga", ".ppm", ".jp2", ".psd")
"""extensions of photos that cannot be read here, but may have been converted since"""
VIDEOS = (".mp4", ".mov", ".m4v", ".mkv", ".webm", ".avi", ".3gp", ".mts", ".m2ts", ".mpg", ".mpeg", ".wmv")
"""extensions of videos, in lower case, from which cameras can be solved"""
DEEPEST, MOST_FILES = 6, 200_000
_LAYER = ".geometry"
"""folder of the photos themselves, among RealityCapture's layers; other folders that are hidden are left"""
JOBS_FOLDER = "nmf_jobs"
"""what Blender writes beside a .blend, with camera files and pictures of its own"""
NO_PHOTOS = (JOBS_FOLDER, "@eaDir")
"""folders that are not looked into; the other has the thumbnails of a network drive"""
_THUMBNAILS = re.compile(r"thumb|preview", re.I)
_DRIVE = re.compile(r"[a-z]:", re.I)
_FORBIDDEN = dict.fromkeys([*range(32), *map(ord, ':<>|"?*')], "_")
_DEVICE = re.compile(r"(con|prn|aux|nul|(com|lpt)\d) *(\.|$)", re.I)


def plain(name: str) -> str:
    """A name in lower case and one spelling: systems write letters with marks in two ways."""
    return unicodedata.normalize("NFC", name).lower()


def numbered(name: str) -> list[tuple[bool, int, str]]:
    """A key to sort names by: numbers by how large they are, all else as text."""
    parts = re.split(r"(\d+)", name.lower())
    return [(p.isdecimal(), int(p) if p.isdecimal() else 0, p) for p in parts if p]


def on_windows(name: str) -> str:
    """What a file or folder of a name is called on Windows, as programs that unpack archives have it."""
    name = name.translate(_FORBIDDEN).rstrip(" .")
    return f"_{name}" if _DEVICE.match(name) else name


def stem_of(name: str) -> str:
    """A file's plain name without a picture's extension, the same on all systems."""
    name = on_windows(plain(name))
    for extension in EXTENSIONS + UNREADABLE:
        if name.endswith(extension):
            return name[: -len(extension)]
    return name


def parts_of(stated: str) -> list[str]:
    """The parts of a path that a file of any system states, without what leads out of a folder: steps
    upwards, a drive, and the slashes that a root or a server begins with."""
    parts = stated.replace("\\", "/").split("/")
    return [part for part in parts if part not in ("", ".", "..") and not _DRIVE.fullmatch(part)]


def folders_of(parts: Sequence[str]) -> list[str]:
    """The plain names of the folders of a path given by its parts."""
    return [plain(part) for part in parts[:-1]]


def agreement(one: Sequence[str], other: Sequence[str]) -> int:
    """How many of the last folders of two paths are the same."""
    count = 0
    for a, b in zip(reversed(one), reversed(other), strict=False):
        if a != b:
            break
        count += 1
    return count


def pictures_below(folder: Path, extensions: tuple[str, ...] = EXTENSIONS) -> Iterator[Path]:
    """Pictures below a folder, not deeper than `DEEPEST`; each folder counts once, whatever links to it.
    Those of a hidden layer come last, and only if no other picture is called so."""
    start, seen, been = len(folder.parts), 0, set()
    layer: list[Path] = []
    names: set[str] = set()
    for place, folders, files in os.walk(folder, followlinks=True):
        real = os.path.realpath(place)
        if real in been:
            folders.clear()
            continue
        been.add(real)
        if len(Path(place).parts) - start >= DEEPEST:
            folders.clear()
        shown = (name for name in folders if not name.startswith(".") or name == _LAYER)
        folders[:] = sorted(name for name in shown if name not in NO_PHOTOS)
        for name in sorted(files):
            seen += 1
            if seen > MOST_FILES:
                return
            if Path(name).suffix.lower() not in extensions or name.startswith("."):
                continue
            if _LAYER in Path(place).parts[start:]:
                layer.append(Path(place) / name)
            else:
                names.add(stem_of(name))
                yield Path(place) / name
    yield from (path for path in layer if stem_of(path.name) not in names)


def pictures_in(folder: Path) -> list[Path]:
    """Pictures that lie in just this folder; none if it cannot be read."""
    try:
        return sorted(path for path in folder.iterdir() if path.suffix.lower() in EXTENSIONS)
    except OSError:
        return []


def folder_called(place: Path, name: str) -> Path:
    """The folder of that name in a place, whatever its letters' case; `place / name` if there is none."""
    try:
        there = [other for other in place.iterdir() if other.name.lower() == name.lower()]
    except OSError:
        there = []
    folders = sorted(other for other in there if other.is_dir())
    return min(folders, key=lambda other: other.name != name, default=place / name)


def largest_copy(paths: Sequence[Path]) -> Path | None:
    """Of one photo in several sizes, in folders called by how much smaller it is there (`images`,
    `images_2`, `images_4`), the largest; None if the sizes do not say so. Thumbnails do not count."""
    paths = [path for path in paths if not _THUMBNAILS.search(path.parent.name)] or paths
    if len(paths) == 1:
        return paths[0]
    whole = {path.parent for path in paths if _factor(path.parent) is None}
    if len(whole) > 1 or any(not _is_smaller(path.parent, whole) for path in paths):
        return None
    wide: dict[Path, tuple[int, int]] = {}
    for path in paths:
        try:
            wide[path] = (_factor(path.parent) or 1, image_size(path)[0])
        except CaptureError:
            return None
    # Each was rounded, up or down, to whole pixels.
    least = max(factor * (width - 1) for factor, width in wide.values())
    most = min(factor * (width + 1) for factor, width in wide.values())
    different = len({factor for factor, _ in wide.values()}) == len(paths)
    return min(wide, key=wide.__getitem__) if different and least <= most else None


def _factor(folder: Path) -> int | None:
    """By how much smaller photos are in a folder that is called so; None if it is not."""
    named = re.fullmatch(r".+_(\d{1,2})", folder.name)
    return int(named[1]) or None if named else None


def _is_smaller(folder: Path, whole: set[Path]) -> bool:
    """True if it is the folder of whole photos, or beside that and called by it; or if there is none."""
    return all(
        folder == other or (folder.parent == other.parent and folder.name.startswith(f"{other.name}_"))
        for other in whole
    )
