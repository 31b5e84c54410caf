"""Captures in one file: .zip as Polycam, 3D Scanner App and collections of data sets give them, Record3D's
.r3d. They are unpacked beside themselves, for photos are read again and again.

An archive comes from anywhere, so nothing in it is trusted: it writes below its own folder alone, no links,
over no file that is there already, and no more than there is room for.
"""

import errno
import os
import shutil
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

from ..replacing import is_too_long, replace_file
from .archive_members import ARCHIVES, MARK, Member, common_folder, members_of, name_of
from .errors import CaptureError, shown
from .files import no_access

_SPARE = 1 << 28
"""bytes that stay free on the disk"""
_PIECE = 1 << 20
_PART = ".part"
"""extension of a file that is being written"""
_REMEDIES = {
    **dict.fromkeys(
        (errno.EACCES, errno.EPERM, errno.EROFS),
        "make that folder writable, or move the archive to one that is",
    ),
    **dict.fromkeys((errno.ENOSPC, errno.EDQUOT, errno.EFBIG), "free space, or move it to another disk"),
}
"""by the number of what writing ended in"""
_DAMAGED = (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, NotImplementedError, ValueError)
"""what reading a member may end in"""


def is_archive(path: Path) -> bool:
    """Whether this is an archive that is unpacked here."""
    return path.suffix.lower() in ARCHIVES and os.path.isfile(path)


def folder_of(path: Path) -> Path:
    """The folder beside an archive that it is unpacked to, of a name that Windows leaves as it is."""
    return path.with_name(path.stem.rstrip(" .") or "unpacked")


def is_of_missing(folder: Path, path: Path) -> bool:
    """Whether a folder is, or lies in, that of an archive that is there no longer."""
    gone = path.suffix.lower() in ARCHIVES and not path.exists()
    return gone and folder.is_relative_to(folder_of(path))


def check_unpacked(path: Path) -> None:
    """Make sure that a folder or a file in it is not of half an archive.

    Raises:
        CaptureError: it is, for unpacking was stopped.
    """
    path = path.absolute()
    for place in (path, *path.parents):
        if os.path.isfile(place / MARK):
            problem = "it is not completely unpacked"
            raise CaptureError(path, "", problem, "give its archive again to continue")


def unpacked(path: Path, told: Callable[[float], None] = lambda fraction: None) -> Path:
    """The folder that an archive holds, unpacked beside it; any other path as it is.

    The folder is called as the archive (`folder_of`). Where it is there already, unpacked here or by a
    person, it is taken as it is; one that was left half done is gone on with.

    Args:
        told: is called with the fraction done.

    Raises:
        CaptureError: it cannot be unpacked, there is no room, or another folder has its name.
    """
    if not is_archive(path):
        return path
    path = Path(os.path.abspath(path))
    try:
        with zipfile.ZipFile(path) as archive:
            members = members_of(path, archive)
            top = common_folder(members)
            within, folder = Path(*top), folder_of(path)
            # What holds one folder of its own name becomes that folder, as macOS has it.
            root = path.parent if top[:1] == (folder.name,) else folder
            if not (folder / MARK).exists():
                for place in (root, folder):
                    if _is_whole(place, members):
                        return place / within
            _unpack(path, archive, members, root, told)
            return root / within
    except OSError as error:
        raise no_access(path, error) from error
    except _DAMAGED as error:
        if isinstance(error, CaptureError):
            raise
        raise _damaged(path, error) from error


def _is_whole(root: Path, members: list[Member]) -> bool:
    """Whether all of an archive's files lie below a folder, as large as they are."""
    return all(_is_there(root.joinpath(*parts), info) for info, parts in members)


def _is_there(file: Path, info: zipfile.ZipInfo) -> bool:
    with suppress(OSError):
        return file.is_file() and file.stat().st_size == info.file_size
    return False


def _unpack(
    path: Path, archive: zipfile.ZipFile, members: list[Member], root: Path, told: Callable[[float], None]
) -> None:
    folder = folder_of(path)
    mark, begun, own = folder / MARK, folder.exists(), _identity(path)
    if begun and not mark.is_file():
        if _is_whole(root, members):
            return  # another process has just ended
        raise CaptureError(
            path, "", f"it would be unpacked to {folder}, where something else is",
            "give that folder if it is the capture, else move it away",
        )  # fmt: skip
    goes_on = begun and mark.read_text(encoding="utf-8", errors="replace") == own
    places = {root.joinpath(*parts): info for info, parts in members}
    if begun and not goes_on and _holds_others(folder, {mark, *places}):
        raise CaptureError(
            path, "", f"it would be unpacked to {folder}, where another archive is half unpacked",
            "move or delete that folder",
        )  # fmt: skip
    own_only = goes_on or not begun
    missing = {p: info for p, info in places.items() if not (own_only and _is_there(p, info))}
    size = sum(info.file_size for info in missing.values())
    free = shutil.disk_usage(path.parent).free
    if size + _SPARE > free:
        problem = f"it takes {size / 1e9:.1f} GB of disk space, and {free / 1e9:.1f} GB are free"
        raise CaptureError(path, "", problem, "free space, or move it to another disk")
    try:
        overtaken = not begun and not _is_made(folder, own)
        if begun and not goes_on:
            mark.write_text(own, encoding="utf-8")
    except OSError as error:
        raise _not_written(path, "", folder, error) from error
    if overtaken:
        return _unpack(path, archive, members, root, told)
    done, now = 0, ""
    try:
        for file, info in missing.items():
            now = shown(name_of(info))
            # Another process may have been faster, and somebody reads it already.
            whole = own_only and _is_there(file, info)
            for piece in [info.file_size] if whole else _pieces_into(file, archive, info):
                done += piece
                if size:
                    told(done / size)
        mark.unlink(missing_ok=True)
    except (OSError, *_DAMAGED) as error:
        # Without the mark, another process has ended well.
        if not begun and mark.exists():
            shutil.rmtree(folder, ignore_errors=True)
        if not isinstance(error, OSError):
            raise
        raise _not_written(path, now, folder, error) from error


def _is_made(folder: Path, mark: str) -> bool:
    """Make a folder that is marked from its first moment on; False if another process was faster."""
    new = folder.with_name(f"{os.getpid()}{_PART}")
    new.mkdir()
    try:
        (new / MARK).write_text(mark, encoding="utf-8")
        replace_file(new, folder)
    except OSError:
        shutil.rmtree(new, ignore_errors=True)
        if not folder.is_dir():
            raise
        return False
    return True


def _holds_others(folder: Path, ours: set[Path]) -> bool:
    """Whether there is anything below a folder but these files, and what was left of writing them."""
    files = (path for path in folder.rglob("*") if not path.is_dir() or path.is_symlink())
    return any(file not in ours and file.suffix != _PART for file in files)


def _pieces_into(file: Path, archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> Iterator[int]:
    """Write a member to a file, which is there when it is whole; yields the sizes of its pieces."""
    file.parent.mkdir(parents=True, exist_ok=True)
    # Not longer than the file's own name, which may be as long as names can be.
    part = file.with_name(f"{os.getpid()}{_PART}")
    try:
        with archive.open(info) as source, part.open("wb") as target:
            while piece := source.read(_PIECE):
                target.write(piece)
                yield len(piece)
        replace_file(part, file)
    finally:
        part.unlink(missing_ok=True)


def _identity(path: Path) -> str:
    """What another archive of the same name has otherwise."""
    found = path.stat()
    return f"{path.name} {found.st_size} {found.st_mtime_ns}"


def _damaged(path: Path, error: Exception) -> CaptureError:
    why = shown(str(error)) or type(error).__name__
    remedy = "download or pack it again, or unpack it yourself"
    return CaptureError(path, "", f"the archive is damaged ({why})", remedy)


def _not_written(path: Path, name: str, folder: Path, error: OSError) -> CaptureError:
    remedy = _REMEDIES.get(error.errno, "unpack it yourself elsewhere and give the folder")
    if is_too_long(error):
        remedy = "move the archive to a folder with a shorter path"
    problem = f"it cannot be unpacked to {folder} ({error.strerror})"
    return CaptureError(path, name, problem, remedy)
