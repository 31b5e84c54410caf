"""Size, orientation and alpha of an image file, by its header and the standard library alone.

Only headers are read, a part at a time, so a file that claims to be huge costs nothing.
"""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from .errors import CaptureError
from .heif_header import has_heif_brand, read_heif_header
from .webp_header import has_webp_mark, webp_exif, webp_has_alpha, webp_size

HEIF = (".heic", ".heif", ".hif", ".avif")
"""extensions, in lower case, of photos that Blender cannot show"""
EXTENSIONS = (".png", ".jpg", ".jpeg", ".jfif", ".webp", *HEIF, ".tif", ".tiff", ".exr", ".hdr")
"""of photos and masks, in lower case"""
FORMATS = "PNG, JPEG, WebP, HEIC, AVIF, TIFF, OpenEXR or Radiance HDR"
MOST_PIXELS = 1 << 28
"""of a photo; a header that states more is damaged or made to exhaust the memory"""

_LFS_POINTER = b"version https://git-lfs.github.com/spec/v1"
"""how a small text begins that stands for a file in Git"""
_WIDTH, _HEIGHT, _ORIENTATION = 256, 257, 274  # TIFF's tags
_MOST_PARTS = 4096  # JPEG segments, EXR attributes or TIFF entries before the size


def image_size(path: Path) -> tuple[int, int]:
    """(width, height) in pixels of an image file of one of the `FORMATS`.

    It is the size of the pixels as they lie in the file: an orientation tag does not count. Of OpenEXR it
    is the picture's, the display window, of which a file may hold a part, or more; of HEIC and AVIF that
    of the picture as it is to be shown, which there is more than a remark.

    Raises:
        CaptureError: the file is none of these, cut off, or of a size that no photo has.
    """
    try:
        with path.open("rb") as file:
            size = _size(file)
            file.seek(0)
            pointer = size is None and file.read(len(_LFS_POINTER)) == _LFS_POINTER
    except (OSError, struct.error, ValueError) as error:
        problem = "it is cut off" if isinstance(error, struct.error) else _reason(error)
        raise CaptureError(
            path, "", f"the image cannot be read ({problem})", "replace the file"
        ) from error
    if pointer:
        raise CaptureError(
            path, "", "this is a Git LFS pointer, not yet the photo",
            "run 'git lfs pull' in its repository",
        )  # fmt: skip
    if size is None:
        raise CaptureError(
            path, "", f"this is no {FORMATS} image",
            "convert the photo to one of these",
        )  # fmt: skip
    width, height = size
    if width < 1 or height < 1 or width * height > MOST_PIXELS:
        raise CaptureError(
            path, "", f"its header states {width} × {height} pixels, which no photo has",
            "replace the file",
        )  # fmt: skip
    return width, height


def image_orientation(path: Path) -> int:
    """EXIF's orientation of a JPEG, WebP or TIFF, 1 to 8; 1, as it lies, where the header states none."""
    try:
        with path.open("rb") as file:
            head = file.read(24)
            file.seek(0)
            if head[:2] == b"\xff\xd8":
                found = _tiff_orientation(_jpeg_exif(file))
            elif has_webp_mark(head):
                found = _tiff_orientation(webp_exif(file))
            else:
                found = _tiff_values(file).get(_ORIENTATION, 1) if _is_tiff(head) else 1
    except (OSError, struct.error, ValueError):
        return 1
    return found if 1 <= found <= 8 else 1


def may_have_alpha(path: Path) -> bool:
    """False for a file that certainly has no alpha channel: JPEG, HDR, what says so in its header."""
    try:
        with path.open("rb") as file:
            head = file.read(26)
            file.seek(0)
            if has_webp_mark(head):
                return webp_has_alpha(file)
            if has_heif_brand(head):
                return read_heif_header(file).has_alpha
    except (OSError, struct.error, ValueError):
        return True
    if head[:8] == b"\x89PNG\r\n\x1a\n" and len(head) == 26:
        return head[25] not in (0, 2)
    return head[:2] not in (b"\xff\xd8", b"#?")


def blender_shows(path: Path) -> bool:
    """False for a photo that Blender cannot decode, by its name alone."""
    return path.suffix.lower() not in HEIF


def is_heif(path: Path) -> bool:
    """True for a HEIC or AVIF file, by its content; phones' programs give some of them other names."""
    try:
        with path.open("rb") as file:
            return has_heif_brand(file.read(24))
    except OSError:
        return False


def _reason(error: Exception) -> str:
    return (error.strerror or "no access") if isinstance(error, OSError) else str(error)


def _size(file: BinaryIO) -> tuple[int, int] | None:
    head = file.read(24)
    file.seek(0)
    if head[:8] == b"\x89PNG\r\n\x1a\n":
        return struct.unpack(">II", head[16:24])
    if head[:2] == b"\xff\xd8":
        return _jpeg_size(file)
    if _is_tiff(head):
        return _tiff_size(file)
    if head[:4] == b"\x76\x2f\x31\x01":
        return _exr_size(file)
    if head[:2] == b"#?":
        return _hdr_size(file)
    if has_webp_mark(head):
        return webp_size(file)
    if has_heif_brand(head):
        header = read_heif_header(file)
        return header.width, header.height
    return None


def _jpeg_segments(file: BinaryIO) -> Iterator[tuple[int, int]]:
    """Markers of a JPEG and their contents' lengths, with the file at the contents."""
    file.seek(2)
    for _ in range(_MOST_PARTS):
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
    """True for the JPEG segment that states the size."""
    return 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC)


def _jpeg_size(file: BinaryIO) -> tuple[int, int]:
    next(length for marker, length in _jpeg_segments(file) if _is_frame(marker))
    _, height, width = struct.unpack(">BHH", file.read(5))
    return width, height


def _jpeg_exif(file: BinaryIO) -> bytes | None:
    """EXIF, a TIFF, of a JPEG; None if it has none."""
    for marker, length in _jpeg_segments(file):
        if _is_frame(marker):
            break
        if marker == 0xE1:
            name, _, tiff = file.read(length).partition(b"\0\0")
            if name == b"Exif" and _is_tiff(tiff):
                return tiff
    return None


def _tiff_orientation(tiff: bytes | None) -> int:
    """The orientation that EXIF states; 1 where it does not."""
    if tiff is None or not _is_tiff(tiff):
        return 1
    return _tiff_values(BytesIO(tiff)).get(_ORIENTATION, 1)


def _is_tiff(head: bytes) -> bool:
    return head[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")


def _tiff_size(file: BinaryIO) -> tuple[int, int]:
    found = _tiff_values(file)
    if _WIDTH not in found or _HEIGHT not in found:
        raise ValueError("its TIFF states no size")
    return found[_WIDTH], found[_HEIGHT]


def _tiff_values(file: BinaryIO) -> dict[int, int]:
    """Width, height and orientation of the first picture, as far as stated; TIFF and BigTIFF, in both
    byte orders."""
    head = file.read(16)
    order = "<" if head[:2] == b"II" else ">"
    big = struct.unpack(order + "H", head[2:4])[0] == 43
    (at,) = struct.unpack(order + ("Q" if big else "I"), head[8:16] if big else head[4:8])
    file.seek(min(at, 1 << 62))
    (count,) = struct.unpack(order + ("Q" if big else "H"), file.read(8 if big else 2))
    found: dict[int, int] = {}
    for _ in range(min(count, _MOST_PARTS)):
        entry = file.read(20 if big else 12)
        tag, kind = struct.unpack(order + "HH", entry[:4])
        value = entry[12:] if big else entry[8:]
        code = {1: "B", 3: "H", 4: "I", 16: "Q"}.get(kind)
        if tag in (_WIDTH, _HEIGHT, _ORIENTATION) and code is not None:
            found[tag] = struct.unpack(order + code, value[: struct.calcsize(code)])[0]
        if len(found) == 3:
            break
    return found


def _exr_size(file: BinaryIO) -> tuple[int, int]:
    file.seek(8)
    sizes = {}
    for _ in range(_MOST_PARTS):
        name = _text(file)
        if not name:
            break
        kind = _text(file)
        (length,) = struct.unpack("<i", file.read(4))
        if length < 0:
            break
        if name in (b"dataWindow", b"displayWindow") and kind == b"box2i":
            x0, y0, x1, y1 = struct.unpack("<4i", file.read(16))
            sizes[name] = x1 - x0 + 1, y1 - y0 + 1
        else:
            file.seek(length, os.SEEK_CUR)
    if b"dataWindow" not in sizes:
        raise ValueError("its OpenEXR header states no size")
    stored = sizes[b"dataWindow"]
    # What is stored has to be decoded, however small the picture.
    too_large = stored[0] * stored[1] > MOST_PIXELS
    return stored if too_large else sizes.get(b"displayWindow", stored)


def _text(file: BinaryIO) -> bytes:
    """A text that ends with a zero byte."""
    start = file.tell()
    text, ending, _ = file.read(256).partition(b"\0")
    if not ending:
        raise ValueError("its OpenEXR header is damaged")
    file.seek(start + len(text) + 1)
    return text


def _hdr_size(file: BinaryIO) -> tuple[int, int]:
    for _ in range(_MOST_PARTS):
        line = file.readline(4096)
        if not line:
            break
        found = re.fullmatch(rb"[-+][XY] +(\d{1,9}) +[-+][XY] +(\d{1,9})\s*", line)
        if found:
            # The first number counts scanlines, whichever axis they run along.
            return int(found[2]), int(found[1])
    raise ValueError("its Radiance header states no size")
