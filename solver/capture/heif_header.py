"""The header of HEIC and AVIF photos: size, turn, alpha and colour, by the standard library alone.

Both are HEIF: boxes in boxes, of which `meta` holds a list of properties and says which of them the
photo has. Phones store a photo as tiles that are put together, and a turn that is no mere remark as
EXIF's is: whoever decodes the file has to follow it.
https://www.iso.org/standard/83650.html (ISO/IEC 23008-12), sections 6.5 and 9
"""

import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

HEIC, AVIF = (b"heic", b"heix", b"heim", b"heis", b"mif1", b"mif2", b"msf1"), (b"avif", b"avis")
"""brands of files; mif1, mif2 and msf1 may stand first in both"""
_MOST_BOXES = 64  # of a file before its `meta`
_MOST_META = 1 << 24  # bytes; a phone's has some thousand
_ALPHA = (b"auxiliary:alpha", b"hevc:2015:auxid:1")
_DAMAGED = "its HEIF header is damaged"
_TURNED = {  # quarter turns to the left, then a mirror (of top and bottom, of the sides), as EXIF has it
    (0, None): 1, (0, 1): 2, (2, None): 3, (0, 0): 4, (1, 0): 5, (3, None): 6, (3, 0): 7, (1, None): 8,
    (2, 0): 2, (2, 1): 4, (3, 1): 5, (1, 1): 7,
}  # fmt: skip


@dataclass(frozen=True)
class HeifHeader:
    """What a HEIF file says of its photo.

    Attributes:
        width, height: pixels, as the photo is to be shown: cropped and turned.
        turn: how its pixels have to be turned for that, in EXIF's numbers from 1 to 8.
        is_avif: its pixels are coded as AV1; else as HEVC.
        has_alpha: one of its pictures is another's alpha.
        primaries, transfer: numbers of ITU-T H.273 (1: Rec. 709, 12: Display P3, …); 2 is not stated.
    """

    width: int
    height: int
    turn: int
    is_avif: bool
    has_alpha: bool
    primaries: int
    transfer: int


def has_heif_brand(head: bytes) -> bool:
    """True for the first 24 bytes of a HEIC or AVIF file."""
    return head[4:8] == b"ftyp" and any(head[at : at + 4] in HEIC + AVIF for at in (8, 16, 20))


def read_heif_header(file: BinaryIO) -> HeifHeader:
    """Read the header of a file that is at its start.

    Raises:
        struct.error: it is cut off. ValueError: it is damaged.
    """
    brands, meta = _brands_and_meta(file)
    children = dict(_boxes(meta[4:]))
    resources = dict(_boxes(children.get(b"iprp", b"")))
    properties = list(_boxes(resources.get(b"ipco", b"")))
    size, angle, mirror, primaries, transfer = None, 0, None, 2, 2
    for index in _properties_of(_primary_item(children), resources.get(b"ipma", b"")):
        if not 1 <= index <= len(properties):
            raise ValueError(_DAMAGED)
        kind, data = properties[index - 1]
        if kind == b"ispe":
            size = struct.unpack(">II", data[4:12])
        elif kind == b"clap":
            size = _cropped(data)
        elif kind == b"irot":
            angle = data[0] & 3 if data else 0
        elif kind == b"imir":
            mirror = data[0] & 1 if data else None
        elif kind == b"colr" and data[:4] == b"nclx":
            primaries, transfer = struct.unpack(">HH", data[4:8])
    if size is None:
        raise ValueError("its HEIF header states no size")
    width, height = size[::-1] if angle % 2 else size
    return HeifHeader(
        width, height, _TURNED[angle, mirror], is_avif=any(brand in brands for brand in AVIF),
        has_alpha=any(name in data for kind, data in properties if kind == b"auxC" for name in _ALPHA),
        primaries=primaries, transfer=transfer,
    )  # fmt: skip


def _brands_and_meta(file: BinaryIO) -> tuple[list[bytes], bytes]:
    brands: list[bytes] = []
    for _ in range(_MOST_BOXES):
        length, kind = struct.unpack(">I4s", file.read(8))
        length -= 8
        if length == 1 - 8:
            length = struct.unpack(">Q", file.read(8))[0] - 16
        if length < 0 or (kind == b"meta" and length > _MOST_META):
            raise ValueError(_DAMAGED)
        if kind == b"meta":
            meta = file.read(length)
            if len(meta) < length:
                raise struct.error("cut off")
            return brands, meta
        if kind == b"ftyp":
            listed = file.read(min(length, 4 * _MOST_BOXES))
            length -= len(listed)
            brands = [listed[at : at + 4] for at in range(0, len(listed), 4)]
        file.seek(min(length, 1 << 62), os.SEEK_CUR)
    raise ValueError(_DAMAGED)


def _boxes(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    at = 0
    while at + 8 <= len(data):
        length, kind = struct.unpack(">I4s", data[at : at + 8])
        if length < 8 or at + length > len(data):
            raise ValueError(_DAMAGED)
        yield kind, data[at + 8 : at + length]
        at += length


def _primary_item(children: dict[bytes, bytes]) -> int:
    """Number of the picture that is the photo; others are its tiles, thumbnail, alpha or depth."""
    data = children.get(b"pitm", b"")
    number = struct.Struct(">I" if data[:1] == b"\1" else ">H")
    return number.unpack(data[4 : 4 + number.size])[0]


def _properties_of(item: int, data: bytes) -> list[int]:
    """Numbers, from 1, of an item's properties, by the contents of the box `ipma`."""
    version, flags, count = struct.unpack(">B2xBI", data[:8])
    number, wide, at = struct.Struct(">IB" if version else ">HB"), flags & 1, 8
    for _ in range(count):
        own, entries = number.unpack(data[at : at + number.size])
        at += number.size
        length = entries * (2 if wide else 1)
        if own == item:
            # The highest bit only says whether a reader has to know the property.
            codes = struct.unpack(f">{entries}{'H' if wide else 'B'}", data[at : at + length])
            return [code & (0x7FFF if wide else 0x7F) for code in codes]
        at += length
    raise ValueError("its HEIF header states no size")


def _cropped(data: bytes) -> tuple[int, int]:
    across, over_a, down, over_d = struct.unpack(">4I", data[:16])
    if not over_a or not over_d:
        raise ValueError(_DAMAGED)
    return across // over_a, down // over_d
