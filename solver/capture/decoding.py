"""Image files as arrays, with what they say about colour, alpha and orientation.

OpenImageIO decodes all but OpenEXR: it keeps 16 bits, floating point and straight alpha as they are,
where Pillow has no 16-bit RGB. Only `photos` imports this module: Blender has no such packages.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenEXR
import OpenImageIO

from .colour import rec709_from_chromaticities
from .errors import CaptureError, shown
from .icc import Profile, read_profile
from .image_header import image_size

_MOST_CHANNELS = 16
_TYPES = {
    "uint8": "uint8", "uint16": "uint16",
    "half": "float", "float": "float", "double": "float",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Decoded:
    """An image as it lies in its file.

    Attributes:
        pixels: [H, W, C] unsigned integers of the file's depth, or float32.
        alpha: the channel of coverage, if there is one; the colour is in the channels before it.
        associated: colours are multiplied by alpha already.
        linear: whole numbers stand for linear light, says the file.
        orientation: EXIF's, 1 to 8; 1 is as it lies.
        profile: the ICC profile, if it is one that `icc` reads and not sRGB.
        matrix: [3, 3] from the file's primaries to Rec. 709; None if they are that.
    """

    pixels: np.ndarray
    alpha: int | None = None
    associated: bool = False
    linear: bool = False
    orientation: int = 1
    profile: Profile | None = None
    matrix: np.ndarray | None = None

    @property
    def is_float(self) -> bool:
        """Values are not bound to [0, 1]."""
        return self.pixels.dtype.kind == "f"

    @property
    def largest(self) -> float:
        """The code of white."""
        return 1.0 if self.is_float else float(np.iinfo(self.pixels.dtype).max)


def decode(path: Path) -> Decoded:
    """Decode a PNG, JPEG, TIFF, OpenEXR or Radiance HDR file.

    Raises:
        CaptureError: it is none of these, damaged, cut off, or claims to be larger than any photo.
    """
    image_size(path)
    try:
        return _decode_exr(path) if _is_exr(path) else _decode_with_openimageio(path)
    except CaptureError:
        raise
    except Exception as error:  # every decoder has its own exceptions
        raise _unreadable(path, type(error).__name__) from error


def read_exr(path: Path) -> tuple[np.ndarray, np.ndarray | None]:
    """RGB [H, W, 3] float32 and alpha [H, W] (None if there is none) of an OpenEXR file.

    Values are as they are stored, whatever primaries the file states.
    """
    channels = _exr_channels(path)
    if not all(name in channels for name in "RGB"):
        names = shown(", ".join(channels))
        raise CaptureError(
            path, "channels", f"it has no R, G and B but {names}", "export an RGB or RGBA image"
        )
    arrays = [_exr_pixels(path, channels, name) for name in "RGB"]
    alpha = _exr_pixels(path, channels, "A") if "A" in channels else None
    return _stacked(path, arrays), alpha


def read_exr_channels(path: Path) -> np.ndarray:
    """An OpenEXR file's [H, W, C]: RGB where it has them, else its one channel."""
    channels = _exr_channels(path)
    names = "RGB" if all(name in channels for name in "RGB") else list(channels)[:1]
    arrays = [_exr_pixels(path, channels, name) for name in names]
    return _stacked(path, arrays).astype(np.float64)


def read_image(path: Path) -> np.ndarray:
    """Pixels [H, W, C] float32 of an image, whole numbers scaled to [0, 1]; EXIF rotation applied."""
    decoded = decode(path)
    return oriented(decoded.pixels, decoded.orientation).astype(np.float32) / decoded.largest


def oriented(pixels: np.ndarray, orientation: int) -> np.ndarray:
    """Pixels [H, W, …] turned upright, a view: what an EXIF orientation from 1 to 8 asks for."""
    if orientation in (5, 6, 7, 8):
        pixels = pixels.swapaxes(0, 1)
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    return pixels


def as_camera_saw(
    pixels: np.ndarray, orientation: int, width: int, height: int
) -> np.ndarray | None:
    """Pixels [H, W, …] of a camera's size, as they lie in the file or else upright; None if neither.

    The one place that decides on EXIF orientation. Programs that solve cameras differ: most ignore
    the tag, some turn the photo first. The size they write down tells them apart, and where it does
    not (squares, half turns) the tag is ignored, as it is for Blender's background images.
    """
    if pixels.shape[:2] == (height, width):
        return pixels
    upright = oriented(pixels, orientation)
    return upright if upright.shape[:2] == (height, width) else None


def _decode_with_openimageio(path: Path) -> Decoded:
    # Else it would multiply by alpha in whole numbers, which loses dark colours.
    wish = OpenImageIO.ImageSpec()
    wish.attribute("oiio:UnassociatedAlpha", 1)
    file = OpenImageIO.ImageInput.open(str(path), wish)
    if file is None:
        raise _unreadable(path, OpenImageIO.geterror())
    try:
        spec = file.spec()
        kind = _TYPES.get(str(spec.format))
        if kind is None or spec.deep or spec.depth > 1 or not 1 <= spec.nchannels <= _MOST_CHANNELS:
            raise CaptureError(
                path, "", "its pixels are of a kind that no photo has",
                "export it with 8 or 16 bits, or in floating point",
            )  # fmt: skip
        pixels = file.read_image(0, 0, 0, spec.nchannels, kind)
        problem = file.geterror()
        if pixels is None or problem:
            raise _unreadable(path, problem)
        alpha = spec.alpha_channel if 0 <= spec.alpha_channel < spec.nchannels else None
        profile = spec.getattribute("ICCProfile")
        profile = None if profile is None else read_profile(bytes(profile))
        orientation = spec.get_int_attribute("Orientation", 1)
        return Decoded(
            pixels.reshape(spec.height, spec.width, spec.nchannels), alpha,
            associated=not spec.get_int_attribute("oiio:UnassociatedAlpha", 0),
            linear=str(spec.getattribute("oiio:ColorSpace") or "").startswith("lin"),
            orientation=orientation if 1 <= orientation <= 8 else 1,
            profile=None if profile is None or profile.is_srgb else profile,
        )  # fmt: skip
    finally:
        file.close()


def _decode_exr(path: Path) -> Decoded:
    rgb, alpha = read_exr(path)
    chromaticities = OpenEXR.File(str(path), header_only=True).header().get("chromaticities")
    try:
        matrix = None if chromaticities is None else rec709_from_chromaticities(chromaticities)
    except ValueError as error:
        raise CaptureError(
            path, "chromaticities", str(error), "export it in linear Rec. 709"
        ) from error
    if alpha is None:
        return Decoded(rgb, associated=True, matrix=matrix)
    pixels = _stacked(path, [*np.moveaxis(rgb, -1, 0), alpha])
    return Decoded(pixels, alpha=3, associated=True, matrix=matrix)


def _is_exr(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(4) == b"\x76\x2f\x31\x01"


def _exr_channels(path: Path) -> dict:
    image_size(path)
    try:
        return OpenEXR.File(str(path), separate_channels=True).channels()
    except Exception as error:  # the binding raises bare exceptions of several kinds
        raise _unreadable(path, type(error).__name__) from error


def _exr_pixels(path: Path, channels: dict, name: str) -> np.ndarray:
    try:
        return np.asarray(channels[name].pixels).astype(np.float32)
    except (TypeError, ValueError) as error:
        raise _unreadable(path, "its pixels are no numbers") from error


def _stacked(path: Path, arrays: list[np.ndarray]) -> np.ndarray:
    if any(array.shape != arrays[0].shape or array.ndim != 2 for array in arrays):
        raise _unreadable(path, "its channels differ in size")
    return np.stack(arrays, axis=-1)


def _unreadable(path: Path, reason: str) -> CaptureError:
    reason = shown((reason.strip() or "unknown reason").splitlines()[0], 100)
    return CaptureError(path, "", f"the image cannot be decoded ({reason})", "replace the photo")
