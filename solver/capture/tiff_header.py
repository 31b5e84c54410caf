"""Directories of a TIFF, by the standard library alone: of photos, of EXIF, of camera raw photos.

TIFF and BigTIFF, in both byte orders, and the marks of makers who write TIFFs that call themselves other.
"""

import struct
from typing import BinaryIO

REDUCED, WIDTH, HEIGHT, PHOTOMETRIC, ORIENTATION, PARTS = 254, 256, 257, 262, 274, 330
"""tags; the last has the places of further directories"""
CAMERA_FIELDS, FOCAL_LENGTH_35MM = 0x8769, 0xA405
"""EXIF's tags: the place of its directory of the camera's, and one of those"""
_MOST_ENTRIES, _MOST_VALUES = 4096, 16
_CODES = {1: "B", 3: "H", 4: "I", 13: "I", 16: "Q"}
_MARKS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_OTHER_MARKS = (b"IIRO", b"IIRS", b"MMOR", b"IIU\0")  # Olympus, Panasonic


def is_tiff(head: bytes) -> bool:
    """True for the first bytes of a TIFF."""
    return head[:4] in _MARKS


def is_makers_tiff(head: bytes) -> bool:
    """True for the first bytes of a raw photo that is a TIFF by another name."""
    return head[:4] in _OTHER_MARKS


def tiff_values(file: BinaryIO) -> dict[int, int]:
    """Width, height, orientation and REDUCED of the first picture, as far as stated; the file is left where
    it says where another one lies.

    Raises:
        struct.error: it is cut off.
    """
    found: dict[int, int] = {}
    order, big, at = _start(file)
    for tag, kind, _, value in _entries(file, order, big, at):
        if tag in (REDUCED, WIDTH, HEIGHT, ORIENTATION) and kind in _CODES:
            code = order + _CODES[kind]
            found[tag] = struct.unpack(code, value[: struct.calcsize(code)])[0]
    return found


def directory(file: BinaryIO, at: int | None = None) -> dict[int, tuple[int, ...]]:
    """All whole numbers of the directory at a place, or of the first; of long lists, the first ones.

    Raises:
        struct.error: it is cut off.
    """
    order, big, first = _start(file)
    entries = list(_entries(file, order, big, first if at is None else at))
    found = {}
    for tag, kind, count, value in entries:
        if kind not in _CODES or count < 1:
            continue
        code = f"{order}{min(count, _MOST_VALUES)}{_CODES[kind]}"
        if count * struct.calcsize(order + _CODES[kind]) > len(value):
            file.seek(min(struct.unpack(order + ("Q" if big else "I"), value)[0], 1 << 62))
            value = file.read(struct.calcsize(code))
        found[tag] = struct.unpack(code, value[: struct.calcsize(code)])
    return found


def _start(file: BinaryIO) -> tuple[str, bool, int]:
    """Byte order, whether it is a BigTIFF, place of the first directory."""
    file.seek(0)
    head = file.read(16)
    order = "<" if head[:2] == b"II" else ">"
    big = struct.unpack(order + "H", head[2:4])[0] == 43
    (at,) = struct.unpack(order + ("Q" if big else "I"), head[8:16] if big else head[4:8])
    return order, big, at


def _entries(file: BinaryIO, order: str, big: bool, at: int):
    """Tag, kind, count and field of each entry of a directory."""
    file.seek(min(at, 1 << 62))
    (count,) = struct.unpack(order + ("Q" if big else "H"), file.read(8 if big else 2))
    for _ in range(min(count, _MOST_ENTRIES)):
        entry = file.read(20 if big else 12)
        own, value = (entry[:12], entry[12:]) if big else (entry[:8], entry[8:])
        yield *struct.unpack(order + ("HHQ" if big else "HHI"), own), value
