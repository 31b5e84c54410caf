"""Photos at a reduced size: decoded fast, turned, in eight bits. For looking at many of them."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from PIL import Image

from .colour import linear_to_srgb
from .decoded import Decoded
from .decoding import decode, decode_photo, unreadable
from .image_header import MOST_PIXELS, focal_35mm, image_orientation, image_size, is_heif, is_raw
from .mask_finder import other_shape
from .masks import coverage, no_mask
from .orientation import oriented, same_shape, turn_for
from .tiff_header import CAMERA_FIELDS, FOCAL_LENGTH_35MM

Image.MAX_IMAGE_PIXELS = MOST_PIXELS
_NOT_BY_PILLOW = (".exr", ".hdr", ".tif", ".tiff")


@dataclass(frozen=True)
class PhotoHeader:
    """What a photo's header says.

    Attributes:
        width, height: pixels, upright.
        focal: focal length in pixels along both axes; None if it does not say.
    """

    width: int
    height: int
    focal: float | None


def read_header(path: Path) -> PhotoHeader:
    """Size and focal length of a photo without decoding it.

    Raises:
        CaptureError: it is no picture.
    """
    width, height = image_size(path)
    if is_raw(path) or path.suffix.lower() in _NOT_BY_PILLOW:
        across = float(focal_35mm(path))
    else:
        try:
            with Image.open(path) as picture:
                fields = picture.getexif().get_ifd(CAMERA_FIELDS)
                across = float(fields.get(FOCAL_LENGTH_35MM) or 0)
        except Exception as error:  # every decoder has its own exceptions
            raise unreadable(path, type(error).__name__) from error
    # A full-frame picture is 36 mm wide; phones mean its longer side.
    focal = across / 36 * max(width, height) if across > 0 else None
    turned = image_orientation(path) >= 5
    return PhotoHeader(*((height, width) if turned else (width, height)), focal)


def load_reduced(
    path: Path, longest: int, seen: tuple[int, int] | None = None
) -> tuple[np.ndarray, np.ndarray | None]:
    """A photo no longer than `longest` pixels.

    Args:
        seen: width and height of its camera, as which it is turned (`orientation.turn_for`); None: upright,
            as its EXIF says.

    Returns:
        colour [H, W, 3] uint8 sRGB and alpha [H, W] uint8, None if it has none.

    Raises:
        CaptureError: it cannot be decoded.
    """
    turn = image_orientation(path)
    if seen is not None:
        turn = turn_for(image_size(path), turn, *seen) or turn
    colour, alpha = _as_it_lies(path, longest, decode_photo)
    return oriented(colour, turn), None if alpha is None else oriented(alpha, turn)


def _as_it_lies(
    path: Path, longest: int, read: Callable[[Path, int], Decoded] = decode
) -> tuple[np.ndarray, np.ndarray | None]:
    """Colour and alpha of `load_reduced`, not turned.

    Args:
        read: what decodes a file that Pillow does not.
    """
    if path.suffix.lower() in _NOT_BY_PILLOW or is_heif(path) or is_raw(path):
        return _of_decoded(read(path, longest), longest)
    try:
        with Image.open(path) as picture:
            # A JPEG is decoded at a half, a quarter or an eighth at a fraction of the time.
            picture.draft("RGB", (longest, longest))
            small = picture
            if small.mode.startswith("I") or small.mode == "F":
                grey = np.asarray(small, dtype=np.float64)
                grey = grey / 257 if grey.max() > 255 else grey
                small = Image.fromarray(np.clip(grey, 0, 255).astype(np.uint8))
            has_alpha = "A" in small.getbands() or "transparency" in small.info
            small = small.convert("RGBA" if has_alpha else "RGB")
            small.thumbnail((longest, longest), Image.Resampling.BOX, reducing_gap=2.0)
            pixels = np.asarray(small)
    except Exception as error:  # every decoder has its own exceptions
        raise unreadable(path, type(error).__name__) from error
    return pixels[..., :3], pixels[..., 3] if has_alpha else None


def load_reduced_mask(
    path: Path, shape: tuple[int, int], photo: tuple[int, int], orientation: int = 1,
    field: str = "mask_path",
) -> np.ndarray:  # fmt: skip
    """A mask [H, W] uint8 at a given size (rows, columns), read and turned as for a fit.

    Args:
        photo: (width, height) of its photo, upright.
        orientation: the photo's; its mask may lie as the photo does.
        field: of the camera that names it.

    Raises:
        CaptureError: it is not there, cannot be decoded, or is of another shape than the photo.
    """
    if not path.is_file():
        raise no_mask(path, field)
    colour, alpha = _as_it_lies(path, max(shape))
    channels = [colour] if alpha is None else [colour, alpha[..., None]]
    decoded = Decoded(np.concatenate(channels, axis=2), None if alpha is None else 3)
    mask = np.round(255 * coverage(decoded)).astype(np.uint8)
    candidates = [oriented(mask, turn) for turn in (1, image_orientation(path), orientation)]
    fitting = next((c for c in candidates if same_shape(c.shape, shape)), None)
    if fitting is None:
        raise other_shape(path, field, image_size(path), photo)
    resized = Image.fromarray(np.ascontiguousarray(fitting)).resize(shape[::-1], Image.Resampling.BOX)
    return np.asarray(resized)


@cache
def _shown() -> np.ndarray:
    """sRGB of linear light in 16 bits."""
    return np.round(255 * linear_to_srgb(np.arange(1 << 16) / 65535)).astype(np.uint8)


def _of_decoded(decoded: Decoded, longest: int) -> tuple[np.ndarray, np.ndarray | None]:
    pixels = decoded.pixels
    if decoded.is_float:
        # Clipped, for radiances do not average well.
        exposure = np.float32(decoded.exposure)
        channels = (np.nan_to_num(c * exposure).clip(0, 1) for c in np.moveaxis(pixels, 2, 0))
        pixels = np.stack([smaller(c.astype(np.float32), longest) for c in channels], axis=2)
    colour = pixels[..., :3] if pixels.shape[2] >= 3 else np.repeat(pixels[..., :1], 3, axis=-1)
    alpha = None if decoded.alpha is None else pixels[..., decoded.alpha]
    if decoded.is_float:
        if (profile := decoded.profile) is not None:
            colour = np.stack([profile.linear(i, colour[..., i]) for i in range(3)], axis=2)
        colour = linear_to_srgb(colour)
    elif decoded.linear and colour.dtype == np.uint16:
        colour = _shown()[colour]
    largest = 255 if colour.dtype == np.uint8 else decoded.largest
    small = smaller(_in_eight_bits(colour, largest), longest)
    return small, None if alpha is None else smaller(_in_eight_bits(alpha, decoded.largest), longest)


def _in_eight_bits(values: np.ndarray, largest: float) -> np.ndarray:
    if values.dtype == np.uint8:
        return np.ascontiguousarray(values)
    if values.dtype == np.uint16:  # few different numbers
        return _in_eight_bits(np.arange(1 << 16), largest)[values]
    return np.round(np.clip(values / largest, 0, 1) * 255).astype(np.uint8)


def smaller(values: np.ndarray, longest: int) -> np.ndarray:
    """A picture [H, W] or [H, W, 3] uint8, or [H, W] float32, of sides no longer than `longest` pixels."""
    picture = Image.fromarray(values)
    picture.thumbnail((longest, longest), Image.Resampling.BOX, reducing_gap=2.0)
    return np.asarray(picture)
