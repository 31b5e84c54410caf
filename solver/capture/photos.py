"""Photos as linear, premultiplied RGBA. The one part of `capture` that needs Pillow and OpenEXR."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import imageio.v3
import numpy as np
import OpenEXR

from .camera import Camera
from .capture import Capture
from .errors import CaptureError


@dataclass(frozen=True, eq=False)
class Photo:
    """A photo's pixels.

    Attributes:
        pixels: [H, W, 4] float32, linear Rec.709, premultiplied alpha, row 0 on top.
        has_alpha: the photo says what is object (alpha channel or mask file).
        is_hdr: values above 1 are radiances, not clipped.
    """

    pixels: np.ndarray
    has_alpha: bool
    is_hdr: bool


def load_photo(camera: Camera) -> Photo:
    """Load the photo of a camera; PNG and JPEG hold sRGB and straight alpha, EXR linear light.

    Raises:
        CaptureError: unreadable, or of another size than the camera's.
    """
    path = camera.image_path
    if path is None:
        raise CaptureError(camera.name, "image", "the camera has no photo", "assign its photo")
    is_hdr = path.suffix.lower() == ".exr"
    rgb, alpha = read_exr(path) if is_hdr else _read_srgb(path)
    if rgb.shape[:2] != (camera.height, camera.width):
        raise CaptureError(
            path, "", f"the photo is {rgb.shape[1]} × {rgb.shape[0]} pixels, but its camera says "
            f"{camera.width} × {camera.height}", "export cameras and photos at one size",
        )  # fmt: skip
    if camera.mask_path is not None:
        mask = _read_mask(camera)
        alpha = mask if alpha is None else alpha * mask
        rgb = rgb * mask[..., None] if is_hdr else rgb
    has_alpha = alpha is not None and bool((alpha < 1).any())
    alpha = np.ones(rgb.shape[:2], np.float32) if alpha is None else alpha
    if not np.isfinite(rgb).all():
        raise CaptureError(path, "", "the photo holds values that are not numbers", "replace it")
    if not is_hdr:
        rgb = rgb * alpha[..., None]
    pixels = np.concatenate([rgb, alpha[..., None]], axis=-1).astype(np.float32)
    return Photo(pixels, has_alpha, is_hdr)


def load_photos(
    capture: Capture, progress: Callable[[int, int], None] | None = None
) -> list[Photo]:
    """Load all photos of a capture, in the cameras' order.

    Raises:
        CaptureError: as `load_photo`; also if no photo shows anything.
    """
    photos = []
    with ThreadPoolExecutor(max_workers=4) as pool:
        for photo in pool.map(load_photo, capture.cameras):
            photos.append(photo)
            if progress is not None:
                progress(len(photos), len(capture.cameras))
    empty = [
        camera for camera, photo in zip(capture.cameras, photos, strict=True)
        if not (photo.pixels[..., 3] > 0).any()
    ]  # fmt: skip
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


def srgb_to_linear(encoded: np.ndarray) -> np.ndarray:
    """Inverse of the sRGB transfer function (IEC 61966-2-1)."""
    curve = ((np.maximum(encoded, 0.04045) + 0.055) / 1.055) ** 2.4
    return np.where(encoded <= 0.04045, encoded / 12.92, curve)


def linear_to_srgb(linear: np.ndarray) -> np.ndarray:
    """The sRGB transfer function, without clipping above 1."""
    curve = 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055
    return np.where(linear <= 0.0031308, 12.92 * linear, curve)


def read_exr(path: Path) -> tuple[np.ndarray, np.ndarray | None]:
    """Linear RGB [H, W, 3] and alpha [H, W] (None if there is none) of an OpenEXR file."""
    channels = _exr_channels(path)
    if not all(name in channels for name in "RGB"):
        raise CaptureError(
            path, "channels", f"it has no R, G and B but {', '.join(channels)}",
            "export an RGB or RGBA image",
        )  # fmt: skip
    rgb = np.stack([channels[name].pixels.astype(np.float32) for name in "RGB"], axis=-1)
    alpha = channels["A"].pixels.astype(np.float32) if "A" in channels else None
    return rgb, alpha


def read_exr_channels(path: Path) -> np.ndarray:
    """An OpenEXR file's [H, W, C]: RGB where it has them, else its one channel."""
    channels = _exr_channels(path)
    names = "RGB" if all(name in channels for name in "RGB") else list(channels)[:1]
    return np.stack([channels[name].pixels.astype(np.float64) for name in names], axis=-1)


def _exr_channels(path: Path) -> dict:
    try:
        return OpenEXR.File(str(path), separate_channels=True).channels()
    except Exception as error:  # the binding raises bare exceptions of several kinds
        raise _unreadable(path, error) from error


def read_image(path: Path) -> np.ndarray:
    """Pixels [H, W, 1–4] of an 8- or 16-bit image, scaled to [0, 1]; EXIF rotation applied."""
    try:
        pixels = imageio.v3.imread(path, plugin="pillow", rotate=True)
    except Exception as error:  # every decoder has its own exceptions
        raise _unreadable(path, error) from error
    if pixels.ndim == 2:
        pixels = pixels[..., None]
    if pixels.ndim != 3 or pixels.dtype.kind not in "ub":
        raise CaptureError(path, "", "this is not a photo of 8 or 16 bits", "export it again")
    largest = 1 if pixels.dtype.kind == "b" else np.iinfo(pixels.dtype).max
    return pixels.astype(np.float32) / largest


def _read_srgb(path: Path) -> tuple[np.ndarray, np.ndarray | None]:
    pixels = read_image(path)
    channels = pixels.shape[2]
    alpha = pixels[..., -1] if channels in (2, 4) else None
    colour = pixels[..., :3] if channels >= 3 else np.repeat(pixels[..., :1], 3, axis=-1)
    return srgb_to_linear(colour).astype(np.float32), alpha


def _read_mask(camera: Camera) -> np.ndarray:
    if not camera.mask_path.is_file():
        raise CaptureError(
            camera.mask_path, "mask_path", "the mask does not exist", "add it or remove mask_path"
        )
    mask = read_image(camera.mask_path)[..., 0]
    if mask.shape != (camera.height, camera.width):
        raise CaptureError(
            camera.mask_path, "mask_path", f"the mask is {mask.shape[1]} × {mask.shape[0]} pixels, "
            f"its photo {camera.width} × {camera.height}", "export both at one size",
        )  # fmt: skip
    return mask


def _unreadable(path: Path, error: Exception) -> CaptureError:
    return CaptureError(
        path, "", f"the image cannot be decoded ({type(error).__name__})", "replace the photo"
    )
