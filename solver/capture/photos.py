"""Photos as linear, premultiplied RGBA. The one part of `capture` that needs more than numpy.

Whole numbers (PNG, JPEG, TIFF) are sRGB and floating point (OpenEXR, HDR, TIFF) is linear Rec. 709,
unless a file states otherwise: an ICC profile of curves and a matrix (Display P3, Adobe RGB) and
OpenEXR's chromaticities are converted; profiles that are tables of colours count as sRGB. Colours
outside Rec. 709 become negative in some channel rather than clipped.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from PIL import Image

from ..threads import thread_pool
from .camera import Camera
from .capture import Capture
from .colour import linear_to_srgb, srgb_to_linear
from .decoded import Decoded
from .decoding import decode_photo, read_exr, read_exr_channels, read_image
from .errors import CaptureError
from .image_circle import Circles
from .masks import read_mask
from .orientation import as_camera_saw
from .photo_settings import PhotoSettings
from .told import both, check_told, made_smaller, told_of

__all__ = [
    "Photo", "PhotoSettings", "at_sizes_of", "linear_to_srgb", "load_photo", "load_photos", "read_exr",
    "read_exr_channels", "read_image", "resized", "srgb_to_linear",
]  # fmt: skip

MOST_AT_ONCE = 4
"""photos that are decoded at once, as many threads, at most"""
_ROWS = 128  # worked on at once, so that a photo takes little more memory than its own pixels


@dataclass(frozen=True, eq=False)
class Photo:
    """A photo's pixels.

    Attributes:
        pixels: [H, W, 4] float32, linear Rec.709, premultiplied alpha, row 0 on top.
        has_alpha: the photo says what is object (alpha channel or mask file), where it is `told`.
        is_hdr: values above 1 are radiances, not clipped.
        backdrop: 'white' or 'black', if alpha is what stood out from that.
        behind: [H, W, 3] float16 sRGB, what is far behind the object, if alpha is what stood out from that.
        unsure: [H, W] bool, with `behind`: where alpha cannot be told.
        told: [H, W] bool, false where the photo says nothing of what is there (see `told` and
            `image_circle`): what its pixels hold there means nothing, nor does alpha. None: it says
            something everywhere.
    """

    pixels: np.ndarray
    has_alpha: bool
    is_hdr: bool
    backdrop: str | None = None
    behind: np.ndarray | None = None
    unsure: np.ndarray | None = None
    told: np.ndarray | None = None

    @property
    def cover(self) -> np.ndarray:
        """Alpha [H, W] of what counts: 0 where the photo says nothing."""
        alpha = self.pixels[..., 3]
        return alpha if self.told is None else alpha * self.told


def load_photo(camera: Camera, settings: PhotoSettings | None = None) -> Photo:
    """Load the photo of a camera with its mask, and where it says something.

    Raises:
        CaptureError: unreadable, or of another size than the camera's; or all of it is to be ignored.
    """
    path = camera.image_path
    if path is None:
        raise CaptureError(camera.name, "image", "the camera has no photo", "assign its photo")
    decoded = decode_photo(path)
    source = as_camera_saw(decoded.pixels, decoded.orientation, camera.width, camera.height)
    if source is None:
        height, width = decoded.pixels.shape[:2]
        raise CaptureError(
            path, "", f"the photo is {width} × {height} pixels, but its camera says "
            f"{camera.width} × {camera.height}", "export cameras and photos at the same size",
        )  # fmt: skip
    linear = _linear_colour(decoded, (settings or PhotoSettings()).colour_space)
    pixels = np.empty((camera.height, camera.width, 4), np.float32)
    for start in range(0, camera.height, _ROWS):
        rows = slice(start, start + _ROWS)
        _fill(pixels[rows], source[rows], decoded, linear)
    if camera.mask_path is not None:
        _cover(pixels, read_mask(camera, decoded.orientation))
    if not np.isfinite(pixels).all():
        raise CaptureError(path, "", "the photo holds values that are not numbers", "replace it")
    told = told_of(camera, decoded.orientation)
    alpha = pixels[..., 3] if told is None else pixels[told, 3]
    return Photo(pixels, bool((alpha < 1).any()), decoded.is_float, told=told)


def resized(photo: Photo, width: int, height: int) -> Photo:
    """The photo at a size, itself if it has that: means of linear premultiplied pixels.

    It says something where all that a pixel is made of does.
    """
    if photo.pixels.shape[1::-1] == (width, height):
        return photo
    channels = (np.ascontiguousarray(photo.pixels[..., c]) for c in range(4))
    channels = [
        np.asarray(Image.fromarray(channel).resize((width, height), Image.Resampling.HAMMING))
        for channel in channels
    ]
    told = made_smaller(photo.told, width, height)
    return replace(photo, pixels=np.stack(channels, axis=2), told=told)


def at_sizes_of(photos: list[Photo], capture: Capture) -> Capture:
    """The capture with cameras of the photos' sizes, that know where these say something."""
    cameras = [
        replace(
            camera.resized(*photo.pixels.shape[1::-1]),
            told=camera.told if photo.told is None else photo.told,
        )
        for camera, photo in zip(capture.cameras, photos, strict=True)
    ]
    return replace(capture, cameras=tuple(cameras))


def load_photos(
    capture: Capture, progress: Callable[[int, int], None] = lambda number, count: None,
    settings: PhotoSettings | None = None, most_pixels: int = 0,
) -> list[Photo]:  # fmt: skip
    """Load all photos of a capture, in the cameras' order.

    Args:
        most_pixels: photos with more are made smaller (see `Camera.no_larger`); 0: none is.

    Raises:
        CaptureError: as `load_photo`; also if one is transparent all over.
    """

    def load(camera: Camera) -> Photo:
        photo, small = load_photo(camera, settings), camera.no_larger(most_pixels)
        photo = resized(photo, small.width, small.height)
        check_told(camera, photo.told)
        return photo

    photos, circles = [], Circles()
    with thread_pool(MOST_AT_ONCE) as pool:
        for camera, photo in zip(capture.cameras, pool.map(load, capture.cameras), strict=True):
            photos.append(photo)
            circles.add(camera, photo.pixels[..., :3])
            progress(len(photos), len(capture.cameras))
    if not any(photo.has_alpha for photo in photos):
        found = circles.found()
        for index, camera in enumerate(capture.cameras):
            if (circle := found.get(camera.lens_key)) is not None:
                photos[index] = replace(photos[index], told=both(photos[index].told, circle))
    empty = [
        camera for camera, photo in zip(capture.cameras, photos, strict=True) if not (photo.cover > 0).any()
    ]
    if len(empty) == len(photos):
        raise CaptureError(
            capture.source, "alpha", "all photos are fully transparent",
            "export the photos with the object's coverage as alpha, or without alpha",
        )  # fmt: skip
    if empty:
        raise CaptureError(
            empty[0].image_path, "alpha", "the photo is fully transparent",
            "replace it or remove its frame from the camera file",
        )  # fmt: skip
    return photos


@dataclass(frozen=True, eq=False)
class _LinearColour:
    """From a file's colours to linear Rec. 709: a curve per channel (None: linear), then a matrix."""

    curves: tuple[Callable[[np.ndarray], np.ndarray], ...] | None
    matrix: np.ndarray | None

    def __call__(self, codes: np.ndarray, largest: float) -> np.ndarray:
        """Linear colours [..., 3] float32 of codes [..., 3] from 0 to `largest`."""
        if self.curves is None:
            linear = codes.astype(np.float32) / np.float32(largest)
        elif codes.dtype in (np.uint8, np.uint16):
            tables = [_table(curve, codes.dtype.str) for curve in self.curves]
            linear = np.stack([tables[i][codes[..., i]] for i in range(3)], axis=-1)
        else:
            scaled = codes.astype(np.float64) / largest
            linear = np.stack([self.curves[i](scaled[..., i]) for i in range(3)], axis=-1)
        if self.matrix is not None:
            linear = linear @ self.matrix.T
        return linear.astype(np.float32, copy=False)


@lru_cache(maxsize=16)
def _table(curve: Callable[[np.ndarray], np.ndarray], dtype: str) -> np.ndarray:
    codes = np.arange(np.iinfo(dtype).max + 1)
    return curve(codes / codes[-1]).astype(np.float32)


def _linear_colour(decoded: Decoded, colour_space: str) -> _LinearColour:
    if colour_space == "srgb":
        return _LinearColour((srgb_to_linear,) * 3, decoded.matrix)
    if colour_space == "linear":
        return _LinearColour(None, decoded.matrix)
    profile = decoded.profile
    if profile is not None:
        return _LinearColour(tuple(partial(profile.linear, i) for i in range(3)), profile.matrix)
    linear = decoded.linear or decoded.is_float
    return _LinearColour(None if linear else (srgb_to_linear,) * 3, decoded.matrix)


def _cover(pixels: np.ndarray, mask: np.ndarray) -> None:
    """Hold the coverage of premultiplied pixels [H, W, 4] to a mask's [H, W] at most.

    Not their product: a mask that is the photo's own alpha once more changes nothing.
    """
    alpha = pixels[..., 3]
    kept = np.divide(mask, alpha, out=np.ones_like(alpha), where=alpha > mask)
    pixels *= kept[..., None]


def _fill(out: np.ndarray, source: np.ndarray, decoded: Decoded, linear: _LinearColour) -> None:
    """Write rows [R, W, 4] from a file's own [R, W, C]."""
    count = source.shape[2] if decoded.alpha is None else decoded.alpha
    codes = source[..., :3] if count >= 3 else np.repeat(source[..., :1], 3, axis=-1)
    if decoded.alpha is None:
        out[..., 3] = 1
    else:
        out[..., 3] = source[..., decoded.alpha] / decoded.largest
        np.clip(out[..., 3], 0, 1, out=out[..., 3])
    cover = out[..., 3:]
    if decoded.alpha is None or (decoded.associated and linear.curves is None):
        out[..., :3] = linear(codes, decoded.largest)
    elif decoded.associated:
        # What was multiplied are the codes, so they are divided before they become light.
        straight = codes / decoded.largest / np.maximum(cover, 1e-6)
        limit = np.inf if decoded.is_float else 1.0
        out[..., :3] = linear(np.minimum(straight, limit), 1.0) * cover
    else:
        out[..., :3] = linear(codes, decoded.largest) * cover
