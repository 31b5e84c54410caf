"""What is in an archive of photos, and what of it may be unpacked: archives come from anywhere."""

import os
import stat
import sys
import zipfile
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import NamedTuple

from .errors import CaptureError, shown
from .files import LEFT_BY_FILE_BROWSERS
from .image_header import EXTENSIONS as PICTURES
from .picture_names import UNREADABLE, VIDEOS, on_windows, parts_of, plain

ARCHIVES = (".zip", ".r3d")
"""extensions of archives, in lower case"""
MARK = ".unpacking"
"""file in a folder that is not unpacked completely yet; it says of which archive"""
_LARGEST_RATIO = 200
"""bytes unpacked to those of the archive: photos have one or two, text may have ten"""
_MOST_FILES = 200_000
_LOCKED = 0x1
_UTF_8 = 0x800
"""bits of a member's flags"""
_ADDED = (*LEFT_BY_FILE_BROWSERS, MARK)
_SHOWN = PICTURES + UNREADABLE + VIDEOS
_WINDOWS = sys.platform == "win32"
_ONE_CASE = sys.platform in ("win32", "darwin")
"""whether disks take letters of either case, and spellings of either kind, for one name"""
_READABLE = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)


class Member(NamedTuple):
    """A file in an archive."""

    info: zipfile.ZipInfo
    parts: tuple[str, ...]  # of its path in the archive


def members_of(path: Path, archive: zipfile.ZipFile) -> list[Member]:
    """The files in an archive, without what systems add.

    Raises:
        CaptureError: one of them must not or cannot be unpacked, or none is a photo.
    """
    # Of two of one name the last counts, as for all programs.
    files: dict[tuple[str, ...], Member] = {}
    for info in archive.infolist():
        name = name_of(info)
        # Older programs on Windows end a folder in a backslash.
        if not name.endswith("/") and not stat.S_ISDIR(info.external_attr >> 16):
            parts = _parts(path, name, info)
            files[tuple(map(plain, parts)) if _ONE_CASE else parts] = Member(info, parts)
    found = [m for m in files.values() if not _is_added(m.parts)]
    if not any(m.parts[-1].lower().endswith(_SHOWN) for m in found):
        if any(m.parts[-1].lower().endswith(ARCHIVES) for m in found):
            raise CaptureError(
                path, "", "there are only other archives in it", "unpack it and give one of those"
            )
        raise CaptureError(path, "", "there are no photos in it", "give an archive with photos")
    for info, _ in found:
        if info.flag_bits & _LOCKED:
            raise _by_hand(path, "it is locked with a password")
        if info.compress_type not in _READABLE:
            raise _by_hand(path, "it is compressed in a way that is not supported")
    size = sum(info.file_size for info, _ in found)
    if len(found) > _MOST_FILES or size > _LARGEST_RATIO * path.stat().st_size:
        problem = f"it holds {len(found)} files of {size / 1e9:.1f} GB, which no archive of photos does"
        raise CaptureError(path, "", problem, "give an archive with photos")
    return found


def _is_added(parts: tuple[str, ...]) -> bool:
    """Whether a file is none of a person's: systems write theirs into every folder that is looked at."""
    name = parts[-1]
    return parts[0] == "__MACOSX" or name.startswith("._") or name.lower() in _ADDED


def name_of(info: zipfile.ZipInfo) -> str:
    """A member's path, with slashes."""
    name = info.filename
    if not info.flag_bits & _UTF_8:
        # macOS writes UTF-8 and does not say so.
        with suppress(UnicodeError):
            name = name.encode("cp437").decode("utf-8")
    return name.replace("\\", "/")


def _parts(path: Path, name: str, info: zipfile.ZipInfo) -> tuple[str, ...]:
    parts = PurePosixPath(name).parts
    kind = stat.S_IFMT(info.external_attr >> 16)
    if kind not in (0, stat.S_IFREG):
        remedy = "pack the photos themselves, not links to them"
        raise CaptureError(path, shown(name), "this is not a file", remedy)
    # Windows cuts off points and blanks at the ends of names, so ".. " may mean "..".
    cut = tuple(map(on_windows, parts))
    if not parts or not all(cut) or parts_of(name) != [*parts]:
        problem = "it would be outside the archive's folder"
        raise CaptureError(path, shown(name), problem, "pack it again")
    return cut if _WINDOWS else parts


def common_folder(members: list[Member]) -> tuple[str, ...]:
    """The path of the one folder, at most in others that hold no more, in which everything lies."""
    return tuple(os.path.commonprefix([member.parts[:-1] for member in members]))


def _by_hand(path: Path, problem: str) -> CaptureError:
    return CaptureError(path, "", problem, "unpack it yourself and give the folder")
