"""Size of an image file from its header, with the standard library alone."""

from __future__ import annotations

import struct
from pathlib import Path

from .errors import CaptureError

EXTENSIONS = (".png", ".jpg", ".jpeg", ".exr")


def image_size(path: Path) -> tuple[int, int]:
    """(width, height) in pixels of a PNG, JPEG or OpenEXR file.

    Raises:
        CaptureError: the file is none of these, or cut off.
    """
    try:
        with path.open("rb") as file:
            head = file.read(1 << 16)
        if head[:8] == b"\x89PNG\r\n\x1a\n":
            return struct.unpack(">II", head[16:24])
        if head[:2] == b"\xff\xd8":
            return _jpeg_size(path.read_bytes())
        if head[:4] == b"\x76\x2f\x31\x01":
            at = head.index(b"dataWindow\0box2i\0") + len(b"dataWindow\0box2i\0") + 4
            x0, y0, x1, y1 = struct.unpack("<4i", head[at : at + 16])
            return x1 - x0 + 1, y1 - y0 + 1
    except (OSError, struct.error, ValueError, IndexError) as error:
        raise CaptureError(
            path, "", f"the image cannot be read ({error})", "replace the file"
        ) from error
    raise CaptureError(
        path, "", "this is no PNG, JPEG or OpenEXR image", "convert the photo to one of these"
    )


def _jpeg_size(data: bytes) -> tuple[int, int]:
    at = 2
    while at + 9 < len(data):
        if data[at] != 0xFF:
            raise ValueError("damaged JPEG")
        marker, length = data[at + 1], struct.unpack(">H", data[at + 2 : at + 4])[0]
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack(">HH", data[at + 5 : at + 9])
            return width, height
        at += 2 + length
    raise ValueError("cut-off JPEG")
