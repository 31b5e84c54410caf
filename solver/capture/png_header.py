"""What a PNG says of its colours by numbers, and its EXIF, by the standard library alone.

https://www.w3.org/TR/png-3/#cICP-chunk, ITU-T H.273
"""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

_MARK = b"\x89PNG\r\n\x1a\n"
_MOST_CHUNKS = 4096  # before the pixels


def png_colours(path: Path) -> tuple[int, int] | None:
    """The numbers of a PNG's primaries and of its transfer function; None if it states none or is none."""
    with path.open("rb") as file:
        for kind, length in _chunks(file):
            if kind == b"cICP" and len(stated := file.read(min(length, 4))) == 4:
                return stated[0], stated[1]
    return None


def png_exif(file: BinaryIO) -> bytes | None:
    """EXIF, a TIFF, of a PNG file that is at its start; None if none stands before the pixels."""
    for kind, length in _chunks(file):
        if kind == b"eXIf":
            return file.read(length)
    return None


def _chunks(file: BinaryIO) -> Iterator[tuple[bytes, int]]:
    """Kind and length of a PNG's chunks before the pixels, the file being at the content of each."""
    if file.read(len(_MARK)) != _MARK:
        return
    for _ in range(_MOST_CHUNKS):
        head = file.read(8)
        if len(head) < 8:
            return  # it is cut off, which its decoder tells
        length, kind = struct.unpack(">I4s", head)
        if kind == b"IDAT":
            return
        at = file.tell()
        yield kind, length
        file.seek(at + length + 4)  # and its checksum
