"""Captures in one file: .zip as Polycam, 3D Scanner App and collections of data sets give them, Record3D's
.r3d. They are unpacked beside themselves, for photos are read again and again.

An archive comes from anywhere, so nothing in it is trusted: it writes below its own folder alone, no links,
over no file that is there already, and no more than there is room for.
"""

from __future__ import annotations

import os
import shutil
import stat
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import NamedTuple

from .errors import CaptureError, shown
from .files import no_access
from .image_header import EXTENSIONS as PICTURES
from .picture_names import UNREADABLE

ARCHIVES = (".zip", ".r3d")
"""extensions of archives, in lower case"""
MARK = ".unpacking"
"""file in a folder that is not unpacked completely yet; it says of which archive"""
_LARGEST_RATIO = 200
"""bytes unpacked to those of the archive: photos have one or two, text may have ten"""
_MOST_FILES = 200_000
_SPARE = 1 << 28
"""bytes that stay free on the disk"""
_PIECE = 1 << 20
_LOCKED = 0x1
_UTF_8 = 0x800
"""bits of a member's flags"""
_READABLE = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_DAMAGED = (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, NotImplementedError, ValueError)
"""what reading a member may end in"""


class _Member(NamedTuple):
    info: zipfile.ZipInfo
    parts: tuple[str, ...]  # of its path in the archive


def is_archive(path: Path) -> bool:
    """Whether this is an archive that is unpacked here."""
    return path.suffix.lower() in ARCHIVES and path.is_file()


def unpacked(path: Path, told: Callable[[float], None] = lambda fraction: None) -> Path:
    """The folder that an archive holds, unpacked beside it; any other path as it is.

    The folder is called as the archive. Where it is there already, unpacked here or by a person, it is
    taken as it is; one that was left half done is gone on with.

    Args:
        told: is called with the fraction done.

    Raises:
        CaptureError: it cannot be unpacked, there is no room, or another folder has its name.
    """
    if not is_archive(path):
        return path
    path = Path(os.path.normpath(path.absolute()))
    try:
        with zipfile.ZipFile(path) as archive:
            members = _members(path, archive)
            top = _only_folder(members)
            within = Path() if top is None else Path(top)
            # What holds one folder of its own name becomes that folder, as macOS has it.
            root = path.parent if top == path.stem else path.parent / path.stem
            for place in (root, path.parent / path.stem):
                if not (path.parent / path.stem / MARK).exists() and _is_whole(place, members):
                    return place / within
            _unpack(path, archive, members, root, told)
            return root / within
    except OSError as error:
        raise no_access(path, error) from error
    except _DAMAGED as error:
        if isinstance(error, CaptureError):
            raise
        raise _damaged(path, error) from error


def _members(path: Path, archive: zipfile.ZipFile) -> list[_Member]:
    """The files in an archive, without what macOS adds.

    Raises:
        CaptureError: one of them must not or cannot be unpacked, or none is a photo.
    """
    found = [_Member(info, _parts(path, info)) for info in archive.infolist() if not info.is_dir()]
    found = [m for m in found if m.parts[0] != "__MACOSX" and not m.parts[-1].startswith("._")]
    if not any(m.parts[-1].lower().endswith(PICTURES + UNREADABLE) for m in found):
        raise CaptureError(path, "", "there are no photos in it", "give an archive with photos")
    for info, _ in found:
        if info.flag_bits & _LOCKED:
            raise _by_hand(path, "it is locked with a password")
        if info.compress_type not in _READABLE:
            raise _by_hand(path, "it is compressed in a way that is not read here")
    size = sum(info.file_size for info, _ in found)
    if len(found) > _MOST_FILES or size > _LARGEST_RATIO * path.stat().st_size:
        problem = (
            f"it holds {len(found)} files of {size / 1e9:.1f} GB, which no archive of photos does"
        )
        raise CaptureError(path, "", problem, "give an archive with photos")
    return found


def _parts(path: Path, info: zipfile.ZipInfo) -> tuple[str, ...]:
    """The parts of a member's path.

    Raises:
        CaptureError: it leads out of the archive's folder, or is a link or a device.
    """
    name = info.filename
    if not info.flag_bits & _UTF_8:
        # macOS writes UTF-8 and does not say so.
        with suppress(UnicodeError):
            name = name.encode("cp437").decode("utf-8")
    name = name.replace("\\", "/")
    parts = PurePosixPath(name).parts
    kind = stat.S_IFMT(info.external_attr >> 16)
    if kind not in (0, stat.S_IFREG):
        remedy = "pack the photos themselves, not links to them"
        raise CaptureError(path, shown(name), "this is no file", remedy)
    if not parts or parts[0].startswith("/") or ".." in parts or any(":" in part for part in parts):
        problem = "it would not lie in the archive's folder"
        raise CaptureError(path, shown(name), problem, "pack it again")
    return parts


def _only_folder(members: list[_Member]) -> str | None:
    """The one folder that everything in an archive lies in, if there is one."""
    tops = {member.parts[0] for member in members}
    return tops.pop() if len(tops) == 1 and all(len(m.parts) > 1 for m in members) else None


def _is_whole(root: Path, members: list[_Member]) -> bool:
    """Whether all of an archive's files lie below a folder, as large as they are."""
    return all(_is_there(root.joinpath(*parts), info) for info, parts in members)


def _is_there(file: Path, info: zipfile.ZipInfo) -> bool:
    with suppress(OSError):
        return file.is_file() and file.stat().st_size == info.file_size
    return False


def _unpack(
    path: Path, archive: zipfile.ZipFile, members: list[_Member], root: Path,
    told: Callable[[float], None],
) -> None:  # fmt: skip
    """Unpack below `root` what is not there yet."""
    folder = path.parent / path.stem
    mark = folder / MARK
    if folder.exists() and not mark.is_file():
        raise CaptureError(
            path, "", f"it would be unpacked to {folder}, where something else is",
            "give that folder if it is the capture, or else move it",
        )  # fmt: skip
    begun, own = folder.exists(), _identity(path)
    goes_on = begun and mark.read_text(encoding="utf-8", errors="replace") == own
    missing = [m for m in members if not (goes_on and _is_there(root.joinpath(*m.parts), m.info))]
    size = sum(info.file_size for info, _ in missing)
    free = shutil.disk_usage(path.parent).free
    if size + _SPARE > free:
        problem = f"it takes {size / 1e9:.1f} GB of disk, and {free / 1e9:.1f} are free"
        raise CaptureError(path, "", problem, "make room, or move it to another disk")
    try:
        folder.mkdir(exist_ok=True)
        mark.write_text(own, encoding="utf-8")
        done = 0
        for info, parts in missing:
            for piece in _pieces_into(root.joinpath(*parts), archive, info):
                done += piece
                told(done / size)
        mark.unlink()
    except (OSError, *_DAMAGED) as error:
        if not begun:
            shutil.rmtree(folder, ignore_errors=True)
        if not isinstance(error, OSError):
            raise
        raise CaptureError(
            path, "", f"it cannot be unpacked to {folder} ({error.strerror})",
            "make that folder writable, or move the archive to one that is",
        ) from error  # fmt: skip


def _pieces_into(file: Path, archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> Iterator[int]:
    """Write a member to a file, which is there when it is whole; yields the sizes of its pieces."""
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_name(f"{file.name}.{os.getpid()}.part")
    try:
        with archive.open(info) as source, part.open("wb") as target:
            while piece := source.read(_PIECE):
                target.write(piece)
                yield len(piece)
        os.replace(part, file)
    finally:
        part.unlink(missing_ok=True)


def _identity(path: Path) -> str:
    """What another archive of the same name has otherwise."""
    found = path.stat()
    return f"{path.name} {found.st_size} {found.st_mtime_ns}"


def _damaged(path: Path, error: Exception) -> CaptureError:
    why = shown(str(error)) or type(error).__name__
    return CaptureError(path, "", f"the archive is damaged ({why})", "download or pack it again")


def _by_hand(path: Path, problem: str) -> CaptureError:
    return CaptureError(path, "", problem, "unpack it yourself and give the folder")
