"""Masks: pictures of the object's coverage. Only `photos`, `reduced` and `told` import this module."""

from pathlib import Path

import numpy as np

from .camera import Camera
from .decoded import Decoded
from .decoding import decode
from .errors import CaptureError
from .mask_finder import other_shape
from .orientation import oriented, same_shape

NEAR_AN_END, MOST_BETWEEN, SHARP = 0.15, 0.35, 0.05
"""share of a mask's range that counts as its end; of what is not black, that may lie between the ends where
edges are soft, and where they are not"""
DARKEST, FEWEST_SHOWN = 0.1, 1e-3
"""of the largest value, below which a mask of more than two values is empty but for noise; and of the
pixels, above which one of two is not"""


def read_mask(camera: Camera, orientation: int, field: str = "mask_path") -> np.ndarray:
    """Coverage [H, W] float32 in [0, 1] from a mask file, at the camera's size.

    Args:
        orientation: the photo's; its mask may lie as the photo does.
        field: of the camera that names it, such as `ignored_path`.

    Raises:
        CaptureError: not there, unreadable, or of another shape than the photo.
    """
    path = getattr(camera, field)
    if not path.is_file():
        raise no_mask(path, field)
    decoded = decode(path)
    mask = coverage(decoded)
    if not np.isfinite(mask).all():
        raise CaptureError(path, "", "the mask holds values that are not numbers", "replace it")
    wanted = (camera.width, camera.height)
    for turned in (1, decoded.orientation, orientation):
        candidate = oriented(mask, turned)
        size = candidate.shape[::-1]
        if size == wanted:
            return np.ascontiguousarray(candidate)
        if same_shape(size, wanted):
            return resized_by_area(candidate, *wanted)
    raise other_shape(path, field, mask.shape[::-1], wanted)


def no_mask(path: Path, field: str = "mask_path") -> CaptureError:
    return CaptureError(path, field, "the mask does not exist", f"add it or remove {field}")


def coverage(decoded: Decoded) -> np.ndarray:
    """Coverage [H, W] float32 in [0, 1] of a mask: its brightness, as it is encoded.

    A picture with an alpha channel that varies has the mask there, if it is of one brightness or an object
    cut out along it. A mask of one colour on black is meant as white on black, however dark that colour is.
    """
    pixels = decoded.pixels
    colours = pixels.shape[2] if decoded.alpha is None else decoded.alpha
    shade = pixels[..., : 3 if colours >= 3 else 1].max(-1).astype(np.float32)
    if decoded.alpha is not None:
        alpha = pixels[..., decoded.alpha].astype(np.float32)
        plain = np.ptp(shade) < 1e-3 * decoded.largest
        if colours == 0 or (np.ptp(alpha) > 0 and (plain or _is_cut_out(shade, alpha, decoded))):
            shade = alpha
    largest = decoded.largest
    if not decoded.is_float and _is_one_on_black(shade, largest):
        largest = shade.max()
    return np.clip(shade / np.float32(largest), 0, 1)


def _is_cut_out(shade: np.ndarray, alpha: np.ndarray, decoded: Decoded) -> bool:
    """True if alpha is a mask, and what it shows is none itself."""
    shown = shade[alpha > (1 - NEAR_AN_END) * decoded.largest]
    if _between(alpha, decoded.largest) > MOST_BETWEEN or not len(shown):
        return False
    is_mask = _between(shown, decoded.largest) < SHARP and shown.min() < NEAR_AN_END * shown.max()
    return not is_mask


def _is_one_on_black(shade: np.ndarray, largest: float) -> bool:
    """True for a mask of black and one other value, exactly, or but for soft edges and what JPEG adds."""
    upper = shade.max()
    black = shade < NEAR_AN_END * upper
    if not black.any():
        return False
    exact = ((shade == upper) | (shade == shade.min())).all() and 1 - black.mean() > FEWEST_SHOWN
    return exact or (upper > DARKEST * largest and _between(shade, upper) <= MOST_BETWEEN)


def _between(values: np.ndarray, upper: float) -> float:
    """Share of those above 0 that are not about `upper` either."""
    above = values > NEAR_AN_END * upper
    return float((values[above] < (1 - NEAR_AN_END) * upper).sum() / max(above.sum(), 1))


def resized_by_area(image: np.ndarray, width: int, height: int) -> np.ndarray:
    """An image [H, W] at another size, each pixel the mean of the area it covers, float32."""
    for axis, count in ((0, height), (1, width)):
        image = np.moveaxis(image, axis, 0).astype(np.float64)
        total = np.concatenate([np.zeros((1, image.shape[1])), np.cumsum(image, axis=0)])
        edges = np.linspace(0, len(image), count + 1)
        below = np.minimum(edges.astype(int), len(image) - 1)
        # The integral up to each edge; its differences are what lies between two edges.
        until = total[below] + (edges - below)[:, None] * image[below]
        image = np.moveaxis(np.diff(until, axis=0) * (count / len(image)), 0, axis)
    return np.clip(image, 0, 1).astype(np.float32)
