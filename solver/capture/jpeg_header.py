"""Size and EXIF of a JPEG, by the standard library alone."""

import os
import struct
from collections.abc import Iterator
from typing import BinaryIO

from .tiff_header import is_tiff

_MOST_SEGMENTS = 4096  # before the size


def jpeg_size(file: BinaryIO) -> tuple[int, int]:
    """(width, height) in pixels.

    Raises:
        struct.error: it is cut off. ValueError: it is damaged.
    """
    next(length for marker, length in _segments(file) if _is_frame(marker))
    _, height, width = struct.unpack(">BHH", file.read(5))
    return width, height


def jpeg_exif(file: BinaryIO) -> bytes | None:
    """EXIF, a TIFF; None if it has none.

    Raises:
        struct.error: it is cut off. ValueError: it is damaged.
    """
    for marker, length in _segments(file):
        if _is_frame(marker):
            break
        if marker == 0xE1:
            name, _, tiff = file.read(length).partition(b"\0\0")
            if name == b"Exif" and is_tiff(tiff):
                return tiff
    return None


def _segments(file: BinaryIO) -> Iterator[tuple[int, int]]:
    """Markers and their contents' lengths, with the file at the contents."""
    file.seek(2)
    for _ in range(_MOST_SEGMENTS):
        start, marker = struct.unpack("BB", file.read(2))
        if start != 0xFF:
            raise ValueError("its JPEG is damaged")
        if marker == 0xFF:  # markers may be padded
            file.seek(-1, os.SEEK_CUR)
            continue
        length = max(struct.unpack(">H", file.read(2))[0], 2) - 2
        at = file.tell()
        yield marker, length
        file.seek(at + length)
    raise ValueError("its JPEG is damaged")


def _is_frame(marker: int) -> bool:
    return 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC)
