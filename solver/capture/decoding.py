"""Image files as arrays, with what they say about colour, alpha and orientation.

OpenImageIO decodes nearly all of them: it keeps 16 bits, floating point and straight alpha as they are,
where Pillow has no 16-bit RGB, and reports a cut-off OpenEXR file, of which its own binding only prints.
Only `photos` and `masks` import this module: Blender's Python need not have the package.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO
from PIL import ExifTags, Image

from .colour import rec709_from_chromaticities, rec709_from_primaries
from .decoded import Decoded
from .errors import CaptureError, shown
from .heif import check_transfer, decode_heif
from .icc import ADOBE_RGB, profile_unless_srgb, read_profile
from .image_header import MOST_PIXELS, image_orientation, image_size, is_heif, is_raw
from .orientation import oriented
from .png_header import png_colours
from .raw import decode_raw

_MOST_CHANNELS, _MOST_VALUES = 64, 4 * MOST_PIXELS
_TYPES = {"uint8": "uint8", "uint16": "uint16", "half": "float", "float": "float", "double": "float"}
_LINEAR = 8
"""the transfer function that is none, in ITU-T H.273"""
_UNCALIBRATED = 0xFFFF
"""EXIF's colour space that is not sRGB"""


def decode(path: Path, least: int = 0) -> Decoded:
    """Decode a PNG, JPEG, WebP, HEIC, AVIF, TIFF, OpenEXR, Radiance HDR or camera raw file.

    Args:
        least: pixels of the longer side that suffice, to look at it; a raw photo may be smaller then
            (`decode_raw`). 0: it has to be whole.

    Raises:
        CaptureError: it is none of these, damaged, cut off, or claims to be larger than any photo.
    """
    image_size(path)
    try:
        if is_raw(path):
            return decode_raw(path, least)
        return decode_heif(path) if is_heif(path) else _decode(path)
    except CaptureError:
        raise
    except Exception as error:  # the binding raises several kinds
        raise unreadable(path, type(error).__name__) from error


def decode_photo(path: Path, least: int = 0) -> Decoded:
    """As `decode`, of a file whose channels have to be colours or grey."""
    decoded = decode(path, least)
    if not decoded.has_colours:
        raise no_colours(path, decoded)
    return decoded


def read_exr(path: Path) -> tuple[np.ndarray, np.ndarray | None]:
    """RGB [H, W, 3] float32 and alpha [H, W] (None if there is none) of an OpenEXR file.

    Values are as they are stored, whatever primaries the file states.

    Raises:
        CaptureError: as `decode`; also if it has no R, G and B.
    """
    decoded = decode(path)
    pixels = decoded.pixels
    if pixels.shape[2] < 3:
        raise no_colours(path, decoded)
    return pixels[..., :3], None if decoded.alpha is None else pixels[..., decoded.alpha]


def read_exr_channels(path: Path) -> np.ndarray:
    """An OpenEXR file's [H, W, C] double: RGB where it has them, else its first channel."""
    pixels = decode(path).pixels
    return pixels[..., : 3 if pixels.shape[2] >= 3 else 1].astype(np.float64)


def read_image(path: Path) -> np.ndarray:
    """Pixels [H, W, C] float32 of an image, whole numbers scaled to [0, 1]; EXIF rotation applied."""
    decoded = decode(path)
    return oriented(decoded.pixels, decoded.orientation).astype(np.float32) / decoded.largest


def _decode(path: Path) -> Decoded:
    # Else it would multiply by alpha in whole numbers, which loses dark colours.
    wish = OpenImageIO.ImageSpec()
    wish.attribute("oiio:UnassociatedAlpha", 1)
    file = OpenImageIO.ImageInput.open(str(path), wish)
    if file is None:
        raise unreadable(path, OpenImageIO.geterror())
    try:
        spec = file.spec()
        is_exr = file.format_name() == "openexr"
        kind = "float" if is_exr else _TYPES.get(str(spec.format))
        ink = spec.get_int_attribute("tiff:PhotometricInterpretation", 1)
        if ink > 7 or (ink, kind) == (0, "uint16"):
            kind = None  # it takes Lab for RGB, and 16 bits of which 0 is white for the reverse
        if kind is None or spec.deep or spec.depth > 1 or not 1 <= spec.nchannels <= _MOST_CHANNELS:
            raise CaptureError(
                path, "", "its pixels are of a kind that no photo has",
                "export it as RGB of 8 or 16 bits, or in floating point",
            )  # fmt: skip
        if spec.width * spec.height * spec.nchannels > _MOST_VALUES:
            raise CaptureError(
                path, "channels", f"it has {spec.nchannels} channels of {spec.width} × {spec.height}, too "
                "many for the memory", "export it with R, G, B and A alone",
            )  # fmt: skip
        pixels = file.read_image(0, 0, 0, spec.nchannels, kind)
        problem = file.geterror()
        if pixels is None or problem:
            raise unreadable(path, problem)
        pixels = pixels.reshape(spec.height, spec.width, spec.nchannels)
        exposure = spec.get_float_attribute("hdr:exposure", 1)
        exposure = exposure if exposure > 0 else 1.0
        if exposure != 1:
            pixels = pixels / np.float32(exposure)
        alpha = spec.alpha_channel if 0 <= spec.alpha_channel < spec.nchannels else None
        if is_exr:
            pixels = _in_display_window(pixels, spec)
            return _of_exr(path, pixels, list(spec.channelnames), spec.getattribute("chromaticities"))
        # Of WebP it follows the wish without saying so, and reads no EXIF.
        is_webp = file.format_name() == "webp"
        straight = is_webp or spec.get_int_attribute("oiio:UnassociatedAlpha", 0)
        orientation = image_orientation(path) if is_webp else spec.get_int_attribute("Orientation", 1)
        profile = spec.getattribute("ICCProfile")
        if profile is not None:
            read = read_profile if kind == "float" else profile_unless_srgb
            profile = read(bytes(profile))
        elif spec.get_int_attribute("Exif:ColorSpace") == _UNCALIBRATED and _is_adobe_rgb(path):
            profile = ADOBE_RGB
        decoded = Decoded(
            pixels, alpha, associated=not straight,
            linear=str(spec.getattribute("oiio:ColorSpace") or "").startswith("lin"),
            orientation=orientation if 1 <= orientation <= 8 else 1,
            profile=profile, channels=tuple(spec.channelnames), exposure=exposure,
        )  # fmt: skip
        stated = png_colours(path) if file.format_name() == "png" else None
        return decoded if stated is None else _in_colours(path, decoded, *stated)
    finally:
        file.close()


def _is_adobe_rgb(path: Path) -> bool:
    """True for a photo whose EXIF has DCF's mark of Adobe RGB, which some cameras write for a profile.

    Design rule for Camera File system 2.0, JEITA CP-3461B: interoperability index "R03".
    """
    try:
        with Image.open(path) as image:
            return image.getexif().get_ifd(ExifTags.IFD.Interop).get(1) == "R03"
    except Exception:  # EXIF can be damaged in any way; the photo need not be
        return False


def _in_colours(path: Path, decoded: Decoded, primaries: int, transfer: int) -> Decoded:
    """A PNG in the colours that it states by H.273's numbers, which go before all else that it says."""
    check_transfer(path, transfer)
    matrix = rec709_from_primaries(primaries)
    return replace(decoded, profile=None, linear=transfer == _LINEAR, matrix=matrix)


def _in_display_window(pixels: np.ndarray, spec: OpenImageIO.ImageSpec) -> np.ndarray:
    """The picture of which a file holds `pixels`: a part, cropped to what is not empty, or a margin more.

    What the file does not hold is zero: black, of no coverage.
    """
    shape = (spec.full_height, spec.full_width)
    left, top = spec.x - spec.full_x, spec.y - spec.full_y
    if (top, left, *pixels.shape[:2]) == (0, 0, *shape):
        return pixels
    picture = np.zeros((*shape, pixels.shape[2]), pixels.dtype)
    held = pixels[max(-top, 0) : max(shape[0] - top, 0), max(-left, 0) : max(shape[1] - left, 0)]
    top, left = max(top, 0), max(left, 0)
    picture[top : top + held.shape[0], left : left + held.shape[1]] = held
    return picture


def _of_exr(
    path: Path, pixels: np.ndarray, names: list[str], chromaticities: tuple[float, ...] | None
) -> Decoded:
    """Channels R, G, B and A, or Y and A, in this order; the first alone if there are neither."""
    colours = "RGB" if all(name in names for name in "RGB") else "Y"
    wanted = [name for name in colours + "A" if name in names]
    if wanted[: len(colours)] != list(colours):
        return Decoded(pixels[..., :1], associated=True, channels=tuple(names))
    order = [names.index(name) for name in wanted]
    if order != list(range(len(names))):
        pixels = pixels[..., order]
    try:
        matrix = None if chromaticities is None else rec709_from_chromaticities(chromaticities)
    except (TypeError, ValueError) as error:
        raise CaptureError(
            path, "chromaticities", shown(str(error)), "export it in linear Rec. 709"
        ) from error
    alpha = len(colours) if len(order) > len(colours) else None
    return Decoded(pixels, alpha, associated=True, matrix=matrix, channels=tuple(names))


def no_colours(path: Path, decoded: Decoded) -> CaptureError:
    names = shown(", ".join(decoded.channels))
    return CaptureError(
        path, "channels", f"it has no R, G and B, only {names}", "export an RGB or RGBA image"
    )


def unreadable(path: Path, reason: str) -> CaptureError:
    """The error for an image that its decoder refuses, with the first line of why."""
    reason = shown((reason.strip() or "unknown reason").splitlines()[0], 100)
    return CaptureError(path, "", f"the image cannot be decoded ({reason})", "replace the photo")
