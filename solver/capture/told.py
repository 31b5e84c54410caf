"""What of a photo says something of what is there: the rest is neither fitted nor compared.

A photo says nothing where its lens model has no ray (`Camera.lens_reaches`: the dark ring around a
fisheye's image, corners beyond a polynomial's fold), and where a person says so by a picture
(`Camera.ignored_path`): a hand, a tripod, a drone's leg, a lens hood. That is no mask of the object, by
which a photo says where the object is not.
"""

from functools import lru_cache

import numpy as np
from PIL import Image
from scipy import ndimage

from .camera import Camera
from .errors import CaptureError
from .image_header import image_orientation
from .masks import read_mask
from .reduced import load_reduced_mask

FAINT = 12 / 255
"""by how much a mask may differ from black, or white, and be that: JPEG is not exact"""
WHOLE = 1 - 1e-4
"""of a pixel that was made of others, from which on all of these count"""
_ROWS = 256  # of a photo, whose rays are looked for at once


def told_of(camera: Camera, orientation: int = 1) -> np.ndarray | None:
    """[H, W] bool: where a camera's photo says something; None: everywhere.

    Args:
        orientation: the photo's; the picture of what is ignored may lie as the photo does.

    Raises:
        CaptureError: that picture is not there, unreadable, or of another shape than the photo; or nothing
            is left of the photo.
    """
    told = _reached(camera.lens_key)
    if camera.ignored_path is not None:
        told = both(told, _kept(read_mask(camera, orientation, "ignored_path"), camera))
    check_told(camera, told)
    return told


def told_of_reduced(camera: Camera, shape: tuple[int, int]) -> np.ndarray | None:
    """As `told_of`, of the photo made smaller, to `shape` rows and columns."""
    told = _reached(camera.resized(*shape[::-1]).lens_key)
    if camera.ignored_path is not None:
        lies = image_orientation(camera.image_path)
        mask = load_reduced_mask(
            camera.ignored_path, shape, (camera.width, camera.height), lies, "ignored_path"
        )
        told = both(told, _kept(mask / np.float32(255), camera))
    check_told(camera, told)
    return told


def check_told(camera: Camera, told: np.ndarray | None) -> None:
    """Make sure that a photo says something somewhere.

    Raises:
        CaptureError: it does not.
    """
    if told is None or told.any():
        return
    if camera.ignored_path is None:
        raise CaptureError(
            camera.image_path or camera.name, "lens", "its lens model has no ray for any of its pixels",
            "solve or export the cameras again",
        )  # fmt: skip
    white = "black" if camera.ignored_is_black else "white"
    raise CaptureError(
        camera.ignored_path, "ignored_path", f"all of the photo '{camera.name}' is to be ignored",
        f"make only what is to be ignored {white}, or leave the photo out",
    )  # fmt: skip


def made_smaller(told: np.ndarray | None, width: int, height: int) -> np.ndarray | None:
    """[height, width] bool: where all that a pixel of `photos.resized` is made of says something."""
    if told is None or told.shape == (height, width):
        return told
    share = Image.fromarray(told.astype(np.float32)).resize((width, height), Image.Resampling.HAMMING)
    told = np.asarray(share) >= WHOLE
    return None if told.all() else told


def filled(colour: np.ndarray, known: np.ndarray | None) -> np.ndarray:
    """Colours [H, W, C], those of the nearest pixel where they are not `known` [H, W]; None: all are."""
    if known is None or known.all() or not known.any():
        return colour
    at = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    return np.where(known[..., None], colour, colour[tuple(at)])


def with_untold(mask: np.ndarray, told: np.ndarray | None) -> np.ndarray:
    """A mask [H, W] and all that its photo says nothing of."""
    return mask if told is None else mask | ~told


def without_untold(mask: np.ndarray, told: np.ndarray | None) -> np.ndarray:
    """What of a mask [H, W] its photo says something of."""
    return mask if told is None else mask & told


def both(told: np.ndarray | None, kept: np.ndarray) -> np.ndarray | None:
    """[H, W] bool: where a photo says something by both; None, as the first may be: everywhere."""
    told = kept if told is None else told & kept
    return None if told.all() else told


def _kept(mask: np.ndarray, camera: Camera) -> np.ndarray:
    """Where a picture [H, W] from 0 to 1 of what is ignored says that the photo counts."""
    return mask >= 1 - FAINT if camera.ignored_is_black else mask <= FAINT


@lru_cache(maxsize=16)
def _reached(key: tuple) -> np.ndarray | None:
    """[H, W] bool: pixels that the lens of cameras with a `Camera.lens_key` has rays for, as it has for
    those beside them, from which rays beside a pixel's centre are told; None: all."""
    camera = Camera("", None, np.eye(4), *key)
    width, height = camera.width, camera.height
    if camera.lens == "pinhole":
        return None
    # What is furthest from the axis lies along the edges: where these are reached, all is.
    column, row = np.arange(width) + 0.5, np.arange(height) + 0.5
    columns = np.concatenate([column, column, 0 * row + column[0], 0 * row + column[-1]])
    rows = np.concatenate([0 * column + row[0], 0 * column + row[-1], row, row])
    if camera.lens_reaches(columns, rows).all():
        return None
    told = np.empty((height, width), bool)
    for start in range(0, height, _ROWS):
        some = row[start : start + _ROWS]
        down, across = np.meshgrid(some, column, indexing="ij")
        told[start : start + _ROWS] = camera.lens_reaches(across.ravel(), down.ravel()).reshape(down.shape)
    told = ndimage.binary_erosion(told, np.ones((3, 3)), border_value=1)
    told.flags.writeable = False
    return told
