"""What a PNG says of its colours by numbers, by the standard library alone.

https://www.w3.org/TR/png-3/#cICP-chunk, ITU-T H.273
"""

import struct
from pathlib import Path

_MARK = b"\x89PNG\r\n\x1a\n"
_MOST_CHUNKS = 4096  # before the pixels


def png_colours(path: Path) -> tuple[int, int] | None:
    """The numbers of a PNG's primaries and of its transfer function; None if it states none or is none."""
    with path.open("rb") as file:
        if file.read(len(_MARK)) != _MARK:
            return None
        for _ in range(_MOST_CHUNKS):
            head = file.read(8)
            if len(head) < 8:
                return None  # it is cut off, which its decoder tells
            length, kind = struct.unpack(">I4s", head)
            if kind == b"IDAT":
                return None
            at = file.tell()
            if kind == b"cICP" and len(stated := file.read(min(length, 4))) == 4:
                return stated[0], stated[1]
            file.seek(at + length + 4)  # and its checksum
    return None
