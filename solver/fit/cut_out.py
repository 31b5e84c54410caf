"""Photos of an object before a plain backdrop get alpha: the fit then begins with its hull."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.ndimage

from ..capture.backdrop import LEVELS, backdrop_of, border_of, coverage_before, object_before
from ..capture.camera import Camera
from ..capture.capture import Capture
from ..capture.photos import Photo, linear_to_srgb, load_photos, srgb_to_linear
from ..capture.plain_surroundings import EVEN_BORDER, surroundings_of
from .seen_space import cell_centres
from .settings import Settings
from .visual_hull import carve, hull_box

CELLS = 64
MOST_MISSING = 0.01
"""share of what photos show that may lie outside of the hull: more, and something was taken for backdrop
that is none"""
FEW = 0.06
"""share of the photos that see a cell which may take it for backdrop while the others show it"""
PROBED = 8
"""photos, evenly taken from all, that tell whether there is a plain backdrop of any colour"""


def cut_out(capture: Capture, photos: list[Photo], region: np.ndarray | None = None) -> list[Photo]:
    """Photos with the object's coverage as alpha, if none has alpha and all are before a plain backdrop.

    A part of the object that looks like what is behind it would be lost, and with it all that lies behind
    it as seen from there. Then the hull no longer holds what other photos show; photos of which that is so
    are returned as they are.

    Args:
        region: [2, 3] world box of the object; None: the capture's.
    """
    backdrop = backdrop_behind(photos)
    box = capture.region if region is None else region
    if backdrop is None:
        return _from_surroundings(capture.cameras, photos, box)
    shown = [object_before(_srgb(photo), backdrop) for photo in photos]
    if not fit_together(capture.cameras, shown, box):
        return photos
    return [
        replace(_with_alpha(photo, mask, LEVELS[backdrop]), backdrop=backdrop)
        for photo, mask in zip(photos, shown, strict=True)
    ]


def photos_as_fitted(
    capture: Capture, settings: Settings, use_masks: bool, region: np.ndarray | None
) -> list[Photo]:
    """Photos to compare a fit's pictures with, loaded and cut out as those of the fit were.

    Args:
        use_masks: the fit's photos had alpha that said what is object, theirs or from being cut out.
        region: [2, 3] world box of the object; None: the capture's.

    Raises:
        CaptureError: a photo cannot be used.
    """
    photos = load_photos(capture, settings=settings.photos)
    if not (settings.fit.cut_out and use_masks):
        return photos
    return cut_out_of_colour(capture, photos, region)


def cut_out_of_colour(
    capture: Capture, photos: list[Photo], region: np.ndarray | None = None
) -> list[Photo]:
    """As `cut_out`, but photos before white or black stay as they are: pictures of a fit have these behind
    the object, too, and no other colour."""
    if backdrop_behind(photos) is not None:
        return photos
    box = capture.region if region is None else region
    return _from_surroundings(capture.cameras, photos, box)


def _from_surroundings(
    cameras: tuple[Camera, ...], photos: list[Photo], region: np.ndarray
) -> list[Photo]:
    """As `cut_out`, before a plain backdrop that is neither white nor black."""
    if any(photo.has_alpha for photo in photos):
        return photos
    probed = [surroundings_of(_srgb(p)) for p in photos[:: max(1, len(photos) // PROBED)]]
    if np.median([0.0 if found is None else found.share for found in probed]) < EVEN_BORDER:
        return photos
    around = [surroundings_of(_srgb(photo)) for photo in photos]
    if any(found is None for found in around):
        return photos
    shown = mended(cameras, [found.shown for found in around], region)
    if shown is None or not fit_together(cameras, shown, region):
        return photos
    return [
        _with_alpha(photo, mask, found.behind)
        for photo, mask, found in zip(photos, shown, around, strict=True)
    ]


def backdrop_behind(photos: list[Photo]) -> str | None:
    """'white' or 'black', if that is plainly behind the object in photos without alpha; else None."""
    if any(photo.has_alpha for photo in photos):
        return None
    return backdrop_of([linear_to_srgb(border_of(photo.pixels[..., :3])) for photo in photos])


def fit_together(
    cameras: tuple[Camera, ...], masks: Sequence[np.ndarray], region: np.ndarray
) -> bool:
    """True if all masks show something, and the hull of all of them holds it."""
    return all(mask.any() for mask in masks) and missing(cameras, masks, region) <= MOST_MISSING


def mended(
    cameras: tuple[Camera, ...], masks: list[np.ndarray], region: np.ndarray
) -> list[np.ndarray] | None:
    """Masks [H, W] as nearly all others have it; None: they have nothing in common.

    In a photo or two, a part of the object looks like the backdrop beside it, but not from elsewhere. And a
    fold in the backdrop or the rim of a turntable stands out from it, but not where the object is.
    """
    listed = list(cameras)
    box = hull_box(listed, lambda: masks, region, CELLS)
    if box is None:
        return None
    points = cell_centres(box, CELLS)
    edge = float((box[1] - box[0]).max()) / CELLS
    seen, against = np.zeros(len(points)), np.zeros(len(points))
    for camera, mask in zip(listed, masks, strict=True):
        at, inside = _pixels(camera, points, mask.shape)
        seen[inside] += 1
        against[inside] += ~mask[at]
    common = (against <= FEW * seen).reshape((CELLS,) * 3)
    # A cell further in, so that outlines stay as each photo has them.
    inner = scipy.ndimage.binary_erosion(common)
    found = []
    for camera, mask in zip(listed, masks, strict=True):
        whole, shared = (
            scipy.ndimage.grey_closing(*_centres(camera, points[cells.ravel()], edge, mask.shape))
            for cells in (inner, common)
        )
        whole |= mask
        parts, _ = scipy.ndimage.label(whole, np.ones((3, 3)))
        found.append(np.isin(parts, np.setdiff1d(parts[shared], 0)))
    return found


def missing(cameras: tuple[Camera, ...], masks: Sequence[np.ndarray], region: np.ndarray) -> float:
    """Share of what masks show that the visual hull of all of them does not cover, over all photos."""
    listed = list(cameras)
    box = hull_box(listed, lambda: masks, region, CELLS)
    if box is None:
        return 1.0
    hull = carve(listed, masks, box, CELLS, whole_cells=True)
    cells = cell_centres(box, CELLS)[hull.ravel()]
    edge = float((box[1] - box[0]).max()) / CELLS
    lost = all_shown = 0
    for camera, mask in zip(listed, masks, strict=True):
        centres, width = _centres(camera, cells, edge, mask.shape)
        if not centres.any():
            return 1.0
        covered = scipy.ndimage.maximum_filter(centres, width)
        lost += int((mask & ~covered).sum())
        all_shown += int(mask.sum())
    return lost / max(all_shown, 1)


def _centres(
    camera: Camera, cells: np.ndarray, edge: float, shape: tuple[int, int]
) -> tuple[np.ndarray, int]:
    """Pixels [H, W] of a photo of this shape where cells have their centres [N, 3]; and an odd number of
    pixels, wider than gaps between them.

    Args:
        edge: of a cell, world units.
    """
    centres = np.zeros(shape, bool)
    at, inside = _pixels(camera, cells, shape)
    if not inside.any():
        return centres, 1
    centres[at] = True
    # A cell is as wide as its neighbours are apart.
    scale = max(camera.fx, camera.fy) * shape[1] / camera.width
    reach = edge * scale / np.median(camera.project(cells[inside])[1])
    return centres, 2 * int(np.ceil(reach)) + 1


def _pixels(
    camera: Camera, points: np.ndarray, shape: tuple[int, int]
) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
    """Rows and columns of the points [N, 3] that a photo of this shape has in its frame; [N] which."""
    height, width = shape
    pixel, depth = camera.project(points)
    pixel = np.nan_to_num(pixel, nan=-1.0) * (width / camera.width, height / camera.height)
    inside = (depth > 0) & (pixel >= 0).all(1) & (pixel < (width, height)).all(1)
    column, row = pixel[inside].astype(int).T
    return (row, column), inside


def _srgb(photo: Photo) -> np.ndarray:
    return linear_to_srgb(photo.pixels[..., :3])


def _with_alpha(photo: Photo, shown: np.ndarray, behind: float | np.ndarray) -> Photo:
    """A photo of which the object is what is `shown` [H, W], and the rest the backdrop.

    Args:
        behind: the backdrop's sRGB level, or its colours [H, W, 3].
    """
    colour = _srgb(photo)
    alpha = coverage_before(colour, shown, behind)[..., None]
    straight = (colour - (1 - alpha) * behind) / np.maximum(alpha, 1e-3)
    mixed = srgb_to_linear(np.clip(straight, 0, np.inf if photo.is_hdr else 1)) * alpha
    partly = (alpha > 0) & (alpha < 1)
    linear = np.where(partly, mixed, photo.pixels[..., :3] * (alpha > 0))
    pixels = np.concatenate([linear, alpha], axis=-1).astype(np.float32)
    return replace(photo, pixels=pixels, has_alpha=True)
