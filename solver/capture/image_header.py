"""Size, orientation and alpha of an image file, by its header and the standard library alone.

Only headers are read, a part at a time, so a file that claims to be huge costs nothing. Sizes of camera
raw photos take LibRaw, which Blender's Python does not have (`UnknownSize`).
"""

import os
import re
import struct
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from .errors import CaptureError
from .files import file_size
from .heif_header import has_heif_brand, read_heif_header
from .jpeg_header import jpeg_exif, jpeg_size
from .png_header import png_exif
from .raw_header import RAW, is_raw_photo, raw_exif, raw_focal_35mm, raw_orientation
from .tiff_header import HEIGHT, ORIENTATION, REDUCED, WIDTH, is_tiff, tiff_values
from .webp_header import has_webp_mark, webp_exif, webp_size_and_alpha

HEIF = (".heic", ".heif", ".hif", ".avif")
EXTENSIONS = (
    ".png", ".jpg", ".jpeg", ".jfif", ".mpo", ".webp", *HEIF, ".tif", ".tiff", ".exr", ".hdr", *RAW,
)  # fmt: skip
"""of photos and masks, in lower case"""
FORMATS = "PNG, JPEG, WebP, HEIC, AVIF, TIFF, OpenEXR, Radiance HDR or camera raw"
MOST_PIXELS = 1 << 28
"""of a photo; a header that states more is damaged or made to exhaust the memory"""

_LFS_POINTER = b"version https://git-lfs.github.com/spec/v1"
"""how a small text begins that stands for a file in Git"""
_MOST_PARTS = 4096  # EXR attributes or HDR lines before the size


class UnknownSize(CaptureError):
    """A size that cannot be read in Blender's Python: that of a camera raw photo."""


def image_size(path: Path) -> tuple[int, int]:
    """(width, height) in pixels of an image file of one of the `FORMATS`.

    It is the size of the pixels as they lie in the file: an orientation tag does not count. Of OpenEXR it
    is the picture's, the display window, of which a file may hold a part, or more; of HEIC and AVIF that
    of the picture as it is to be shown, which there is more than a remark; of camera raw photos that of
    the picture within the sensor's border.

    Raises:
        CaptureError: the file is none of these, cut off, or of a size that no photo has.
        UnknownSize: it is a camera raw photo, and this is Blender.
    """
    try:
        with _opened(path) as file:
            size = _raw_size(path) if is_raw_photo(file, path.suffix) else _size(file)
            file.seek(0)
            pointer = size is None and file.read(len(_LFS_POINTER)) == _LFS_POINTER
    except CaptureError:
        raise
    except (OSError, struct.error, ValueError) as error:
        problem = "it is cut off" if isinstance(error, struct.error) else _reason(error)
        raise CaptureError(path, "", f"the image cannot be read ({problem})", "replace the file") from error
    if pointer:
        raise CaptureError(
            path, "", "this is a Git LFS pointer, not yet the photo", "run 'git lfs pull' in its repository"
        )
    if size is None:
        raise CaptureError(path, "", f"this is no {FORMATS} image", "convert the photo to one of these")
    width, height = size
    if width < 1 or height < 1 or width * height > MOST_PIXELS:
        raise CaptureError(
            path, "", f"its header states {width} × {height} pixels, which no photo has", "replace the file"
        )
    return width, height


def _opened(path: Path) -> BinaryIO:
    """A file to read from: no pipe or device, for which reading may wait for ever."""
    file_size(path)
    return path.open("rb")


def image_orientation(path: Path) -> int:
    """EXIF's orientation of a JPEG, WebP, PNG, TIFF or raw photo, 1 to 8; 1, as it lies, where its header
    states none."""
    try:
        with _opened(path) as file:
            head = file.read(24)
            file.seek(0)
            if head[:2] == b"\xff\xd8":
                found = _tiff_orientation(jpeg_exif(file))
            elif has_webp_mark(head):
                found = _tiff_orientation(webp_exif(file))
            elif head[:4] == b"\x89PNG":
                found = _tiff_orientation(png_exif(file))
            elif is_raw_photo(file, path.suffix):
                exif = raw_exif(file)
                found = 1 if exif is None else raw_orientation(exif)
            else:
                found = tiff_values(file).get(ORIENTATION, 1) if is_tiff(head) else 1
    except (OSError, struct.error, ValueError):
        return 1
    return found if 1 <= found <= 8 else 1


def focal_35mm(path: Path) -> int:
    """The focal length, mm, that EXIF of a raw or TIFF states for full-frame cameras; 0 if it does not."""
    try:
        with _opened(path) as file:
            exif = raw_exif(file)
            return 0 if exif is None else raw_focal_35mm(exif)
    except (OSError, struct.error, ValueError):
        return 0


def may_have_alpha(path: Path) -> bool:
    """False for a file that certainly has no alpha channel: JPEG, HDR, raw, what says so in its header."""
    try:
        with _opened(path) as file:
            head = file.read(26)
            file.seek(0)
            if has_webp_mark(head):
                return webp_size_and_alpha(file)[1]
            if has_heif_brand(head):
                return read_heif_header(file).has_alpha
            if is_raw_photo(file, path.suffix):
                return False
    except (OSError, struct.error, ValueError):
        return True
    if head[:8] == b"\x89PNG\r\n\x1a\n" and len(head) == 26:
        return head[25] not in (0, 2)
    return head[:2] not in (b"\xff\xd8", b"#?")


def blender_shows(path: Path) -> bool:
    """False for a photo that Blender cannot decode, by its name alone."""
    return developed(path) == 2


def developed(path: Path) -> int:
    """How far a photo is on its way to one that every program reads, by its name: 0 is raw, 1 HEIC, AVIF
    or MPO, 2 any other. Of photos of one name in one folder the furthest counts."""
    extension = path.suffix.lower()
    return 0 if extension in RAW else 1 if extension in (*HEIF, ".mpo") else 2


def is_heif(path: Path) -> bool:
    """True for a HEIC or AVIF file, by its content; phones' programs give some of them other names."""
    try:
        with _opened(path) as file:
            return has_heif_brand(file.read(24))
    except OSError:
        return False


def is_raw(path: Path) -> bool:
    """True for a camera raw photo, by its content."""
    try:
        with _opened(path) as file:
            return is_raw_photo(file, path.suffix)
    except OSError:
        return False


def _raw_size(path: Path) -> tuple[int, int]:
    if find_spec("rawpy") is None:
        raise UnknownSize(
            path, "", "the size of a raw photo cannot be read in Blender",
            "let Solve Cameras find the cameras, or develop the photos to TIFF or JPEG",
        )  # fmt: skip
    from .raw import raw_size

    return raw_size(path)


def _reason(error: Exception) -> str:
    return (error.strerror or "no access") if isinstance(error, OSError) else str(error)


def _size(file: BinaryIO) -> tuple[int, int] | None:
    head = file.read(24)
    file.seek(0)
    if head[:8] == b"\x89PNG\r\n\x1a\n":
        return struct.unpack(">II", head[16:24])
    if head[:2] == b"\xff\xd8":
        return jpeg_size(file)
    if is_tiff(head):
        return _tiff_size(file)
    if head[:4] == b"\x76\x2f\x31\x01":
        return _exr_size(file)
    if head[:2] == b"#?":
        return _hdr_size(file)
    if has_webp_mark(head):
        return webp_size_and_alpha(file)[0]
    if has_heif_brand(head):
        header = read_heif_header(file)
        return header.width, header.height
    return None


def _tiff_orientation(tiff: bytes | None) -> int:
    if tiff is None or not is_tiff(tiff):
        return 1
    return tiff_values(BytesIO(tiff)).get(ORIENTATION, 1)


def _tiff_size(file: BinaryIO) -> tuple[int, int]:
    found = tiff_values(file)
    if WIDTH not in found or HEIGHT not in found:
        raise ValueError("its TIFF states no size")
    if found.get(REDUCED, 0) & 1 and any(file.read(4)):  # another follows
        raise ValueError("its first picture is a thumbnail; export it with one picture, or")
    return found[WIDTH], found[HEIGHT]


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
        found = re.fullmatch(rb"-Y +(\d{1,9}) +\+X +(\d{1,9})\s*", line)
        if found:
            return int(found[2]), int(found[1])
    raise ValueError("its Radiance header states no size, or another order of pixels than -Y +X")
