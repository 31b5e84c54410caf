"""What tells a camera raw photo from others, and its EXIF, by the standard library alone.

Its size is not among that: each maker states it elsewhere, and only LibRaw (`raw`) knows where.
"""

import os
import struct
from collections.abc import Iterator
from contextlib import suppress
from io import BytesIO
from typing import BinaryIO

from .jpeg_header import jpeg_exif
from .tiff_header import (
    CAMERA_FIELDS,
    FOCAL_LENGTH_35MM,
    ORIENTATION,
    PARTS,
    PHOTOMETRIC,
    directory,
    is_makers_tiff,
    is_tiff,
)

RAW = (
    ".dng", ".cr2", ".cr3", ".crw", ".nef", ".nrw", ".arw", ".sr2", ".srf", ".raf", ".orf", ".rw2", ".rwl",
    ".pef", ".srw", ".3fr", ".fff", ".iiq", ".erf", ".mef", ".mos", ".mrw",
)  # fmt: skip
"""extensions, in lower case, of camera raw photos"""

_FUJIFILM, _CANON, _OLD_CANON, _MINOLTA = b"FUJIFILMCCD-RAW", b"ftypcrx ", b"HEAPCCDR", b"\0MRM"
_OF_A_SENSOR = (32803, 34892)
"""values of TIFF's PHOTOMETRIC: a mosaic of colours, a camera's own colours"""
_DNG_VERSION, _SAMPLE_FORMAT = 50706, 339
_CANON_FIELDS = bytes.fromhex("85c0b687820f11e08111f4ce462b6a48")
_MOST_BOXES, _MOST_EXIF = 64, 1 << 18


def is_raw_photo(file: BinaryIO, extension: str) -> bool:
    """True for a camera raw photo, by its content; leaves the file at its start.

    A TIFF is one if its pixels are a sensor's; or if it is called so, for not all makers say it.
    """
    head = _head(file)
    if is_tiff(head):
        sensors = (_DNG_VERSION in part or _is_of_a_sensor(part) for part in _parts(file))
        found = extension.lower() in RAW or any(sensors)
        file.seek(0)
        return found
    return (
        is_makers_tiff(head) or head[4:12] == _CANON or head[6:14] == _OLD_CANON
        or head.startswith((_FUJIFILM, _MINOLTA))
    )  # fmt: skip


def raw_exif(file: BinaryIO) -> BinaryIO | None:
    """A TIFF with the photo's EXIF: the file itself, or a part of it; None if none is found.

    Raises:
        struct.error: it is cut off. ValueError: it is damaged.
    """
    head = _head(file)
    if is_tiff(head) or is_makers_tiff(head):
        return file
    if head.startswith(_FUJIFILM):
        file.seek(84)
        at, length = struct.unpack(">II", file.read(8))
        file.seek(at)
        tiff = jpeg_exif(BytesIO(file.read(min(length, _MOST_EXIF))))
        return None if tiff is None else BytesIO(tiff)
    if head[4:12] == _CANON:
        return _exif_of_canon(file)
    return None


def raw_orientation(tiff: BinaryIO) -> int:
    """EXIF's orientation in `raw_exif`; 1 where it states none.

    Raises:
        struct.error: it is cut off.
    """
    return directory(tiff).get(ORIENTATION, (1,))[0]


def raw_focal_35mm(tiff: BinaryIO) -> int:
    """The focal length, mm, that a full-frame camera would need; 0 where EXIF does not say.

    Raises:
        struct.error: it is cut off.
    """
    fields = directory(tiff).get(CAMERA_FIELDS)
    return 0 if fields is None else directory(tiff, fields[0]).get(FOCAL_LENGTH_35MM, (0,))[0]


def _head(file: BinaryIO) -> bytes:
    file.seek(0)
    head = file.read(24)
    file.seek(0)
    return head


def is_floating(file: BinaryIO) -> bool:
    """True for a DNG of floating-point numbers, as HDR merges are."""
    return any(_is_of_a_sensor(part) and part.get(_SAMPLE_FORMAT, ())[:1] == (3,) for part in _parts(file))


def _parts(file: BinaryIO) -> Iterator[dict[int, tuple[int, ...]]]:
    """The directories of a TIFF's first picture and its parts, as far as they are whole."""
    with suppress(struct.error):
        yield (first := directory(file))
        for at in first.get(PARTS, ()):
            yield directory(file, at)


def _is_of_a_sensor(part: dict[int, tuple[int, ...]]) -> bool:
    return part.get(PHOTOMETRIC, (0,))[0] in _OF_A_SENSOR


def _exif_of_canon(file: BinaryIO) -> BinaryIO | None:
    """The first of the TIFFs that a CR3 holds in its boxes, which has the orientation."""
    end = file.seek(0, os.SEEK_END)
    for kind, at, stop in _boxes(file, 0, end):
        if kind != b"moov":
            continue
        for inner, start, last in _boxes(file, at, stop):
            file.seek(start)
            if inner != b"uuid" or file.read(16) != _CANON_FIELDS:
                continue
            for field, begin, until in _boxes(file, start + 16, last):
                if field == b"CMT1":
                    file.seek(begin)
                    return BytesIO(file.read(min(until - begin, _MOST_EXIF)))
    return None


def _boxes(file: BinaryIO, at: int, end: int):
    """Kind, start and end of the contents of boxes between two places."""
    for _ in range(_MOST_BOXES):
        file.seek(at)
        head = file.read(8)
        if at + 8 > end or len(head) < 8:
            return
        length, kind = struct.unpack(">I4s", head)
        start = at + 8
        if length == 1:
            length, start = struct.unpack(">Q", file.read(8))[0], at + 16
        stop = at + length
        if stop <= at or stop > end:
            return
        yield kind, start, stop
        at = stop
