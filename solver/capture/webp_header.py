"""The header of WebP photos: size, alpha and orientation, by the standard library alone.

https://developers.google.com/speed/webp/docs/riff_container, RFC 9649
"""

import struct
from collections.abc import Iterator
from typing import BinaryIO

_MOST_CHUNKS = 4096
_ALPHA_FLAG = 0x10


def has_webp_mark(head: bytes) -> bool:
    """True for the first 24 bytes of a WebP file."""
    return head[:4] == b"RIFF" and head[8:12] == b"WEBP"


def webp_exif(file: BinaryIO) -> bytes | None:
    """EXIF, a TIFF, of a WebP file that is at its start; None if it has none."""
    for kind, length in _chunks(file):
        if kind == b"EXIF":
            return file.read(length).removeprefix(b"Exif\0\0")
    return None


def webp_size_and_alpha(file: BinaryIO) -> tuple[tuple[int, int], bool]:
    """(width, height) of a WebP file that is at its start, and whether it says that it has coverage.

    Raises:
        struct.error: it is cut off. ValueError: it is damaged.
    """
    kind, _ = next(_chunks(file), (b"", 0))
    if kind == b"VP8X":  # a canvas, of one less than its size
        flags, low, high = struct.unpack("<B3x3s3s", file.read(10))
        width, height = (int.from_bytes(side, "little") + 1 for side in (low, high))
        return (width, height), bool(flags & _ALPHA_FLAG)
    if kind == b"VP8L":
        signature, bits = struct.unpack("<BI", file.read(5))
        if signature != 0x2F:
            raise ValueError("its WebP header is damaged")
        return ((bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1), bool(bits >> 28 & 1)
    if kind == b"VP8 ":
        start, width, height = struct.unpack("<3x3sHH", file.read(10))
        if start != b"\x9d\x01\x2a":
            raise ValueError("its WebP header is damaged")
        return (width & 0x3FFF, height & 0x3FFF), False
    raise ValueError("its WebP header is damaged")


def _chunks(file: BinaryIO) -> Iterator[tuple[bytes, int]]:
    """Kinds of a WebP's chunks and their contents' lengths, with the file at the contents."""
    file.seek(12)
    for _ in range(_MOST_CHUNKS):
        head = file.read(8)
        if len(head) < 8:
            return
        kind, length = struct.unpack("<4sI", head)
        at = file.tell()
        yield kind, length
        file.seek(at + length + length % 2)
