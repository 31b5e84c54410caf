"""Text, JSON and XML from files that may be cut off, huge or hostile; with the standard library alone."""

import errno
import json
import os
import re
import stat
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from .errors import CaptureError

CUT_OFF = "the file seems cut off or edited; export it again"
LARGEST_TEXT = 1 << 28
"""bytes; a camera file of a thousand photos with all its sparse points has a tenth of that"""
LONGEST_LINE = 1 << 24
"""bytes; COLMAP writes all observations of a photo into one, and half a million of them have that many"""
MOST_IN_JSON, MOST_IN_XML = LARGEST_TEXT >> 5, LARGEST_TEXT >> 4
"""lists and objects, or elements, in a file; with nothing inside they take twenty times the memory of their
text. Those that say where a point is and who sees it are longer than 32 bytes, and 16, in the mean."""
LEFT_BY_FILE_BROWSERS = (".ds_store", "._.ds_store", "desktop.ini", "thumbs.db")
"""what Finder and Explorer put, hidden, into a folder that somebody has looked at"""
_UTF_16 = (b"\xff\xfe", b"\xfe\xff")
"""how text in it begins"""
_NO_TEXT = re.compile(r"[\x00-\x08\x0e-\x19\x1c-\x1f]")
"""control characters that no text has"""
_ENCODING = re.compile(rb"""(?<=\s)encoding\s*=\s*["'][\w.-]*["']""")


def read_bytes(path: Path, largest: int = LARGEST_TEXT) -> bytes:
    """All of a file.

    Raises:
        CaptureError: it cannot be read, or is larger than any camera file.
    """
    try:
        if file_size(path) > largest:
            raise CaptureError(
                path, "", f"it has more than {largest >> 20} MB, which no camera file has",
                "give the camera file",
            )  # fmt: skip
        return path.read_bytes()
    except OSError as error:
        raise no_access(path, error) from error


def file_size(path: Path) -> int:
    """Bytes in a file.

    Raises:
        OSError: there is none, or it is a pipe or a device, as a link may lead to: these never end.
    """
    found = path.stat()
    if not (stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode)):
        raise OSError(errno.EINVAL, "this is not a file but a pipe or a device")
    return found.st_size


def check_readable(path: Path) -> None:
    """Make sure that a file can be opened.

    Raises:
        CaptureError: it cannot.
    """
    try:
        path.open("rb").close()
    except OSError as error:
        raise no_access(path, error) from error


def file_below(folder: Path, place: Path, name: str) -> Path | None:
    """The file of a name, or of a path from `place` on; None if there is none or it leads out of `folder`.

    Nothing outside is asked for: whoever asks what a path of another computer leads to has asked that one.
    """
    # A name may be too long for any file, no text that files can have as theirs, or a link to itself.
    with suppress(OSError, RuntimeError, ValueError):
        folder = folder.resolve()
        file = Path(os.path.normpath(place.resolve() / name))
        if file.is_relative_to(folder):
            file = file.resolve()
            if file.is_relative_to(folder) and file.is_file():
                return file
    return None


def no_access(path: Path, error: OSError) -> CaptureError:
    return CaptureError(
        path, "", f"it cannot be read ({error.strerror})", "check the path and its permissions"
    )


def head_of(path: Path, count: int = 1 << 16) -> bytes:
    """The first bytes of a file; empty if it cannot be read."""
    try:
        size = file_size(path)
        with path.open("rb") as file:
            # Asked for more than there is, Python sets that much memory aside.
            return file.read(min(count, size))
    except OSError:
        return b""


def text_head(path: Path, count: int = 256) -> bytes:
    """The first bytes of a text file in UTF-8, without a byte order mark and leading blanks; also of one in
    UTF-16, as Windows' shell writes it; nothing of an archive."""
    head = head_of(path, count)
    if head[:2] in _UTF_16:
        head = as_text(head, "ignore").encode("utf-8", "ignore")
    return b"" if head[:4] == b"PK\3\4" else head.lstrip(b"\xef\xbb\xbf \r\n\t")


def json_head(path: Path, count: int = 1 << 20) -> bytes:
    """The first bytes of a file that begins as a JSON object does, cut off or not; else nothing."""
    head = text_head(path, count)
    return head if head[:1] == b"{" else b""


def json_holds(path: Path, *keys: str, count: int = 1 << 20) -> bool:
    """True for a file that begins as a JSON object does, with all these keys in its first bytes."""
    head = json_head(path, count)
    return all(f'"{key}"'.encode() in head for key in keys)


def as_text(content: bytes, errors: str = "replace") -> str:
    """Text in UTF-8, with or without a byte order mark, or in UTF-16 with one."""
    encoding = "utf-16" if content[:2] in _UTF_16 else "utf-8-sig"
    return content.decode(encoding, errors)


def read_text(path: Path) -> str:
    """A text file in UTF-8, with or without a byte order mark, or in UTF-16 with one.

    Bytes that are no UTF-8 stay as Python's file names have them: Excel and other programs write tables in
    Windows' code pages, and just names of photos have such letters.

    Raises:
        CaptureError: as `read_bytes`; also for anything but text.
    """
    with suppress(UnicodeDecodeError):
        text = as_text(read_bytes(path), "surrogateescape")
        if not _NO_TEXT.search(text):
            return text
    raise CaptureError(path, "", "this is not a text file", "give a camera file")


def read_lines(path: Path) -> Iterator[tuple[str, str]]:
    """Lines of a text file in UTF-8, without blanks at their ends, each with its place ("line 1").

    They are read one by one, for lists of sparse points can have gigabytes; bytes that are no UTF-8 stay as
    in `read_text`.

    Raises:
        CaptureError: it cannot be read, is not text, or has a line longer than any camera file's.
    """
    try:
        file_size(path)
        with path.open("rb") as file:
            pieces = iter(partial(file.readline, LONGEST_LINE + 1), b"")
            for index, raw in enumerate(pieces, start=1):
                where = f"line {index}"
                if b"\0" in raw:
                    raise CaptureError(path, where, "this is not text", "give a camera file")
                if len(raw) > LONGEST_LINE:
                    problem = f"it has more than {LONGEST_LINE >> 20} MB, which no camera file's has"
                    raise CaptureError(path, where, problem, "give a camera file")
                if index == 1:
                    raw = raw.removeprefix(b"\xef\xbb\xbf")
                yield where, raw.decode("utf-8", "surrogateescape").strip()
    except OSError as error:
        raise no_access(path, error) from error


def read_json(path: Path) -> Any:
    """Parsed JSON.

    Raises:
        CaptureError: as `read_text`; also with the line where the JSON breaks off.
    """
    text = read_text(path)
    _check_inside(path, text.count("[") + text.count("{"), MOST_IN_JSON, "lists and objects")
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise CaptureError(
            path, f"line {error.lineno}", f"this is not valid JSON ({error.msg})", CUT_OFF
        ) from error
    except (RecursionError, ValueError) as error:
        problem = "its JSON is nested too deeply or holds a number of absurd length"
        raise CaptureError(path, "", problem) from error


def read_xml(path: Path) -> ElementTree.Element:
    """The root of an XML file; files that define entities are refused.

    Raises:
        CaptureError: as `read_bytes`; also with the line where the XML breaks off.
    """
    content = read_bytes(path)
    if content[:2] in _UTF_16:  # then what its first line says of that does not hold any longer
        content = as_text(content).encode("utf-8", "replace")
        content = _ENCODING.sub(b"", content, count=1)
    plain = content.replace(b"\0", b"")  # also of UTF-16 without a mark
    if b"<!DOCTYPE" in plain or b"<!ENTITY" in plain:
        raise CaptureError(path, "DOCTYPE", "no camera file has one")
    _check_inside(path, plain.count(b"</") + plain.count(b"/>"), MOST_IN_XML, "elements")
    try:
        return ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        line = getattr(error, "position", (0, 0))[0]
        raise CaptureError(path, f"line {line}", "this is not valid XML", CUT_OFF) from error
    except RecursionError as error:
        raise CaptureError(path, "", "its XML is nested too deeply") from error


def _check_inside(path: Path, count: int, most: int, what: str) -> None:
    """Make sure that a file has no more inside than memory is there for."""
    if count > most:
        raise CaptureError(
            path, "", f"it has more than {most >> 20} million {what}, which no camera file has",
            "give the camera file",
        )  # fmt: skip
