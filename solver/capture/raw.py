"""Camera raw photos as arrays: developed plainly, and the same way for all photos of a capture.

LibRaw puts the colours of a sensor's pixels together and takes them to linear Rec. 709, by the camera's
matrix and the white balance that it was set to. Nothing is made brighter: neither what a photo's own
brightest pixel would ask for nor what a DNG says of how it is to be shown (BaselineExposure), for both
differ from photo to photo where the light did not. Code 65535 is a saturated sensor.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import rawpy

from .decoded import Decoded
from .errors import CaptureError
from .image_header import MOST_PIXELS, image_orientation
from .raw_header import is_floating

_WHOLE = 0.5
"""share of a sensor's sides from which on the part that a camera calls the picture is taken for it"""


def raw_size(path: Path) -> tuple[int, int]:
    """(width, height) in pixels of a raw photo as it lies: of the part that the camera calls the picture.

    Other programs develop that part, too; the sensor's border around it is left out.

    Raises:
        CaptureError: LibRaw does not know the camera, or the file is damaged.
    """
    with path.open("rb") as file:
        if is_floating(file):
            raise CaptureError(
                path, "", "it has floating-point numbers, as merged photos have, and no known white",
                "export all to OpenEXR, or to TIFF of 16 bits",
            )  # fmt: skip
    with _opened(path) as raw:
        sizes = raw.sizes
        if sizes.raw_width * sizes.raw_height > MOST_PIXELS:
            return sizes.raw_width, sizes.raw_height
        _, _, width, height = _picture(sizes)
    return width, height


def decode_raw(path: Path, least: int = 0) -> Decoded:
    """Develop a raw photo: [H, W, 3] of 16 bits, linear, as it lies.

    Args:
        least: pixels of the longer side that suffice, to look at it; then it may have half its size, in a
            third of the time, with red and blue half a pixel of the whole one's off. 0: it is whole.

    Raises:
        CaptureError: LibRaw does not know the camera, or the file is cut off or damaged.
    """
    with _opened(path) as raw:
        left, top, width, height = _picture(raw.sizes)
        half = 0 < 2 * least <= max(width, height) and _is_bayer(raw)
        shape = raw.sizes.height, raw.sizes.width
        pixels = raw.postprocess(_how(raw, half))
    if half:
        left, top, width, height = (side // 2 for side in (left, top, width, height))
        shape = tuple((side + 1) // 2 for side in shape)
    if pixels.shape[:2] != shape:
        raise ValueError("its picture has another size than its header says")
    pixels = pixels.reshape(*shape, -1)[top : top + height, left : left + width]
    return Decoded(pixels, linear=True, orientation=image_orientation(path))


def as_shot_white(path: Path) -> tuple[float, float] | None:
    """By what the camera multiplied red and blue, against green, for white to be white; None: unknown.

    Raises:
        CaptureError: as `decode_raw`.
    """
    with _opened(path) as raw:
        red, green, blue = raw.camera_whitebalance[:3]
    return (red / green, blue / green) if min(red, green, blue) > 0 else None


@contextmanager
def _opened(path: Path) -> Iterator[rawpy.RawPy]:
    """The file, its header read; LibRaw's errors are told as ours."""
    try:
        with rawpy.RawPy() as raw:
            raw.open_file(str(path))
            yield raw
    except (rawpy.LibRawFileUnsupportedError, rawpy.NotSupportedError) as error:
        raise CaptureError(
            path, "", "raw photos of this camera or kind cannot be read",
            "develop all to TIFF of 16 bits, or to JPEG, under the same names",
        ) from error  # fmt: skip
    except rawpy.LibRawUnsufficientMemoryError as error:
        raise MemoryError from error
    except rawpy.LibRawError as error:
        is_cut = isinstance(error, rawpy.LibRawIOError)
        raise CaptureError(
            path, "", f"the raw photo is {'cut off' if is_cut else 'damaged'}", "replace the photo"
        ) from error


def _picture(sizes: rawpy.ImageSizes) -> tuple[int, int, int, int]:
    """Left, top, width and height of the picture in what LibRaw develops."""
    if not 0.995 <= sizes.pixel_aspect <= 1.005:
        raise ValueError("its pixels are not square")
    left, top = sizes.crop_left_margin - sizes.left_margin, sizes.crop_top_margin - sizes.top_margin
    width, height = sizes.crop_width, sizes.crop_height
    # Pictures have even sides. LibRaw lets them begin at an even pixel of the sensor and leaves out the one
    # before, where that is the first.
    if width % 2 and left > 0:
        left, width = left - 1, width + 1
    if height % 2 and top > 0:
        top, height = top - 1, height + 1
    fits = left >= 0 and top >= 0 and left + width <= sizes.width and top + height <= sizes.height
    if fits and width >= _WHOLE * sizes.width and height >= _WHOLE * sizes.height:
        return left, top, width, height
    return 0, 0, sizes.width, sizes.height


def _is_bayer(raw: rawpy.RawPy) -> bool:
    pattern = raw.raw_pattern
    return pattern is not None and pattern.shape == (2, 2) and raw.num_colors == 3


def _how(raw: rawpy.RawPy, half: bool) -> rawpy.Params:
    options = {}
    as_shot = raw.camera_whitebalance[:3]
    if min(as_shot) <= 0:
        # Else LibRaw would balance each photo by its own mean colour.
        options["user_wb"] = list(raw.daylight_whitebalance)
    if raw.raw_type is rawpy.RawType.Stack and (black := max(raw.black_level_per_channel[:3])) > 0:
        # Of photos whose colours are put together already, LibRaw takes off black but scales by white.
        options["user_sat"] = max(raw.white_level - black, 1)
    return rawpy.Params(
        gamma=(1, 1), no_auto_bright=True, adjust_maximum_thr=0.0, output_bps=16,
        demosaic_algorithm=rawpy.DemosaicAlgorithm.PPG, output_color=rawpy.ColorSpace.sRGB,
        highlight_mode=rawpy.HighlightMode.Clip, use_camera_wb="user_wb" not in options, user_flip=0,
        half_size=half, **options,
    )  # fmt: skip
