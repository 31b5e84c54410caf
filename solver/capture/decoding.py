"""Image files as arrays, with what they say about colour, alpha and orientation.

OpenImageIO decodes all of them: it keeps 16 bits, floating point and straight alpha as they are, where
Pillow has no 16-bit RGB, and reports a cut-off OpenEXR file, of which its own binding only prints.
Only `photos` and `masks` import this module: Blender's Python need not have the package.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenImageIO

from .colour import rec709_from_chromaticities
from .errors import CaptureError, shown
from .icc import Profile, read_profile
from .image_header import image_size
from .orientation import oriented

_MOST_CHANNELS = 64
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
        channels: what the file calls its channels, all of them.
    """

    pixels: np.ndarray
    alpha: int | None = None
    associated: bool = False
    linear: bool = False
    orientation: int = 1
    profile: Profile | None = None
    matrix: np.ndarray | None = None
    channels: tuple[str, ...] = ()

    @property
    def has_colours(self) -> bool:
        """The channels are colours or grey; those of an OpenEXR file may be anything."""
        return (
            self.pixels.shape[2] > 1
            or self.channels[:1] in ((), ("Y",), ("I",))
            or not self.is_float
        )

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
        return _decode(path)
    except CaptureError:
        raise
    except Exception as error:  # the binding raises several kinds
        raise _unreadable(path, type(error).__name__) from error


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
        raise _unreadable(path, OpenImageIO.geterror())
    try:
        spec = file.spec()
        is_exr = file.format_name() == "openexr"
        kind = "float" if is_exr else _TYPES.get(str(spec.format))
        if kind is None or spec.deep or spec.depth > 1 or not 1 <= spec.nchannels <= _MOST_CHANNELS:
            raise CaptureError(
                path, "", "its pixels are of a kind that no photo has",
                "export it with 8 or 16 bits, or in floating point",
            )  # fmt: skip
        pixels = file.read_image(0, 0, 0, spec.nchannels, kind)
        problem = file.geterror()
        if pixels is None or problem:
            raise _unreadable(path, problem)
        pixels = pixels.reshape(spec.height, spec.width, spec.nchannels)
        alpha = spec.alpha_channel if 0 <= spec.alpha_channel < spec.nchannels else None
        if is_exr:
            pixels = _in_display_window(pixels, spec)
            return _of_exr(
                path, pixels, list(spec.channelnames), spec.getattribute("chromaticities")
            )
        profile = spec.getattribute("ICCProfile")
        profile = None if profile is None else read_profile(bytes(profile))
        orientation = spec.get_int_attribute("Orientation", 1)
        return Decoded(
            pixels, alpha, associated=not spec.get_int_attribute("oiio:UnassociatedAlpha", 0),
            linear=str(spec.getattribute("oiio:ColorSpace") or "").startswith("lin"),
            orientation=orientation if 1 <= orientation <= 8 else 1,
            profile=None if profile is None or profile.is_srgb else profile,
            channels=tuple(spec.channelnames),
        )  # fmt: skip
    finally:
        file.close()


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
    """The error for an image whose channels are no colours."""
    names = shown(", ".join(decoded.channels))
    return CaptureError(
        path, "channels", f"it has no R, G and B but {names}", "export an RGB or RGBA image"
    )


def _unreadable(path: Path, reason: str) -> CaptureError:
    reason = shown((reason.strip() or "unknown reason").splitlines()[0], 100)
    return CaptureError(path, "", f"the image cannot be decoded ({reason})", "replace the photo")
