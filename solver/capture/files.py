"""Text, JSON and XML from files that may be cut off, huge or hostile; with the standard library alone."""

from __future__ import annotations

import errno
import json
import math
import os
import re
import stat
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from .errors import CaptureError, shown

LARGEST_TEXT = 1 << 28
"""bytes; a camera file of a thousand photos with all its sparse points has a tenth of that"""
LONGEST_LINE = 1 << 24
"""bytes; COLMAP writes all observations of a photo into one, and half a million of them have that many"""
MOST_IN_JSON, MOST_IN_XML = LARGEST_TEXT >> 5, LARGEST_TEXT >> 4
"""lists and objects, or elements, in a file; with nothing inside they take twenty times the memory of their
text. Those that say where a point is and who sees it are longer than 32 bytes, and 16, in the mean."""
_UTF_16 = (b"\xff\xfe", b"\xfe\xff")
"""how text in it begins"""


_NO_TEXT = re.compile(r"[\x00-\x08\x0e-\x19\x1c-\x1f]")
"""control characters that no text has"""
_ENCODING = re.compile(rb"""(?<=\s)encoding\s*=\s*["'][\w.-]*["']""")
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+(e[+-]?\d+)?", re.I)


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
        raise OSError(errno.EINVAL, "this is no file, but a pipe or a device")
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
    """The error that a file cannot be read."""
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
    UTF-16, as Windows' shell writes it."""
    head = head_of(path, count)
    if head[:2] in _UTF_16:
        head = as_text(head, "ignore").encode("utf-8", "ignore")
    return head.lstrip(b"\xef\xbb\xbf \r\n\t")


def json_head(path: Path, count: int = 1 << 20) -> bytes:
    """The first bytes of a file that begins as a JSON object does, cut off or not; else nothing."""
    head = text_head(path, count)
    return head if head[:1] == b"{" else b""


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
    try:
        text = as_text(read_bytes(path), "surrogateescape")
    except UnicodeDecodeError as error:
        raise CaptureError(path, "", "this is not a text file", "give a camera file") from error
    if _NO_TEXT.search(text):
        raise CaptureError(path, "", "this is not a text file", "give a camera file")
    return text


def read_lines(path: Path) -> Iterator[tuple[int, str]]:
    """Lines of a text file in UTF-8 with their numbers from 1, without blanks at their ends.

    They are read one by one, for lists of sparse points can have gigabytes. Bytes that are no UTF-8
    (names of photos, in another encoding) stay as Python's file names have them.

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
                    problem = (
                        f"it has more than {LONGEST_LINE >> 20} MB, which no camera file's has"
                    )
                    raise CaptureError(path, where, problem, "give a camera file")
                if index == 1:
                    raw = raw.removeprefix(b"\xef\xbb\xbf")
                yield index, raw.decode("utf-8", "surrogateescape").strip()
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
            path, f"line {error.lineno}", f"this is not valid JSON ({error.msg})",
            "the file seems cut off or edited; export it again",
        ) from error  # fmt: skip
    except (RecursionError, ValueError) as error:
        problem = "its JSON is nested too deeply or holds a number of absurd length"
        raise CaptureError(path, "", problem, "export it again") from error


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
        raise CaptureError(path, "DOCTYPE", "no camera file has one", "export it again")
    _check_inside(path, plain.count(b"</") + plain.count(b"/>"), MOST_IN_XML, "elements")
    try:
        return ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        line = getattr(error, "position", (0, 0))[0]
        raise CaptureError(
            path, f"line {line}", "this is not valid XML",
            "the file seems cut off or edited; export it again",
        ) from error  # fmt: skip
    except RecursionError as error:
        raise CaptureError(path, "", "its XML is nested too deeply", "export it again") from error


def _check_inside(path: Path, count: int, most: int, what: str) -> None:
    """Make sure that a file has no more inside than memory is there for.

    Raises:
        CaptureError: it has.
    """
    if count > most:
        raise CaptureError(
            path, "", f"it has more than {most >> 20} million {what}, which no camera file has",
            "give the camera file",
        )  # fmt: skip


def number(path: Path, field: str, value: Any) -> float:
    """A finite number from a number or its text.

    Raises:
        CaptureError: anything else.
    """
    try:
        if isinstance(value, (int, float, str)) and not isinstance(value, bool):
            found = float(value)
            if math.isfinite(found):
                return found
    except (ValueError, OverflowError):
        pass
    raise CaptureError(path, field, f"'{shown(value)}' is not a number", "correct the value")


def numbers(path: Path, field: str, values: Any, count: int | None = None) -> np.ndarray:
    """Finite numbers [N] double, from a list or from text with blanks or commas between them.

    Args:
        count: how many there must be, if that is known.

    Raises:
        CaptureError: anything else.
    """
    if isinstance(values, str):
        words = values.split()
        if (len(words) == count or count is None and len(words) > 1) and any(
            _DECIMAL_COMMA.fullmatch(word) for word in words
        ):
            raise CaptureError(
                path,
                field,
                f"'{shown(values)}' has decimal commas",
                "export it with decimal points",
            )
        values = values.replace(",", " ").split()
    if not isinstance(values, (list, tuple)) or (count is not None and len(values) != count):
        wanted = "numbers" if count is None else f"{count} numbers"
        words = isinstance(values, list) and all(isinstance(value, str) for value in values)
        text = shown(" ".join(values) if words else values)
        raise CaptureError(path, field, f"'{text}' is not {wanted}", "export it again")
    return np.array([number(path, field, value) for value in values], dtype=np.float64)


def mapping(path: Path, field: str, value: Any) -> dict:
    """The value itself, if it is a JSON object.

    Raises:
        CaptureError: anything else.
    """
    if not isinstance(value, dict):
        raise CaptureError(path, field, f"'{shown(value)}' is not an object", "export it again")
    return value


def entries(path: Path, field: str, value: Any) -> list:
    """The value itself, if it is a list; an absent or empty value is an empty list.

    Raises:
        CaptureError: anything else.
    """
    if value in (None, "", {}):
        return []
    if not isinstance(value, list):
        raise CaptureError(path, field, f"'{shown(value)}' is not a list", "export it again")
    return value


def rigid_pose(path: Path, field: str, value: Any) -> np.ndarray:
    """A rigid [4, 4] double from a [4, 4] or [3, 4] matrix; a uniform scale of its axes is dropped.

    Raises:
        CaptureError: no such matrix, or one that is singular, sheared or mirrors the world.
    """
    remedy = "solve or export the cameras again"
    matrix = _pose_matrix(value)
    if matrix is None:
        raise CaptureError(path, field, "a pose must be a 4 × 4 matrix of numbers", remedy)
    if not np.isfinite(matrix).all() or np.abs(matrix).max() > 1e12:
        raise CaptureError(path, field, "the pose holds a value that is not a number", remedy)
    u, scale, vt = np.linalg.svd(matrix[:3, :3])
    if scale[2] < 1e-6 * max(scale[0], 1e-12):
        raise CaptureError(path, field, "the pose's rotation is singular", remedy)
    if scale[0] > 1.02 * scale[2]:
        raise CaptureError(path, field, "the pose's axes are not at right angles", remedy)
    if np.linalg.det(matrix[:3, :3]) < 0:
        raise CaptureError(path, field, "the pose mirrors the world", remedy)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = u @ vt, matrix[:3, 3]
    return pose


def check_quaternion(path: Path, field: str, quaternion: Sequence[float], remedy: str) -> None:
    """Make sure that four numbers, in whatever order, are about a unit quaternion.

    Raises:
        CaptureError: they are not.
    """
    if not 0.5 < np.linalg.norm(quaternion) < 2:
        raise CaptureError(path, field, "its quaternion is no rotation", remedy)


def is_no_pose(value: Any) -> bool:
    """True for what programs write where they could not align a photo: null, or a matrix of the right
    shape that holds what is no number, or zeros alone."""
    if value is None:
        return True
    matrix = _pose_matrix(value)
    return matrix is not None and not (np.isfinite(matrix).all() and matrix[:3].any())


def _pose_matrix(value: Any) -> np.ndarray | None:
    """A double [4, 4] or [3, 4], whatever its numbers are; None for anything else."""
    try:
        matrix = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return None
    return matrix if matrix.shape in ((4, 4), (3, 4)) else None
