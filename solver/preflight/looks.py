"""One quick look at every photo, at a reduced size: the numbers all checks of photos judge by."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np
from PIL import Image
from scipy import ndimage

from ..capture.backdrop import backdrop_of, border_of, border_share, object_before
from ..capture.camera import Camera
from ..capture.capture import Capture
from ..capture.image_header import image_orientation
from ..capture.photos import Photo, at_sizes_of
from ..capture.plain_surroundings import EVEN_BORDER, surroundings_of
from ..capture.reduced import load_reduced_mask, smaller
from ..capture.sharpness import FEWEST_PIXELS, sharpness_of
from ..capture.told import filled, without_untold
from ..fit.before_far import COMPARED, at_size, cut_out_before_far
from ..fit.common_masks import fit_together, mended
from ..threads import thread_pool
from .reduced_photos import MOST_AT_ONCE, TO_LINEAR, ReducedPhotos

WHOLE = 230
"""of 255, from which on a mask shows something fully"""
_THUMBNAIL = 32
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)


@dataclass(frozen=True, eq=False)
class Look:
    """What a photo looks like where the object is (its mask, else the region's place in the frame).

    Attributes:
        sharpness: log2 of fine over middle detail at the strongest edges; NaN without any.
        clipped: share of pixels with a channel at its upper end.
        exposure: log2 of the luminance, mean over its middle half.
        white_border: share of the frame's border that is white.
        coverage: share of the frame that the mask shows; None without a mask.
        cut: share of the frame's border that the mask shows; 0 without.
        across: pixels of the photo that the mask's box measures, its longer side; None without.
        thumbnail: [32, 32, 3] int16.
        half_shown: share of what the mask shows that it does not show fully; 0 without.
        mask: [H, W] bool, reduced; None without.
        backdrop: 'white', 'black' or 'plain' (any other), if the mask is what stands out from that; 'far',
            if from surroundings that are far away.
    """

    camera: Camera
    sharpness: float
    clipped: float
    exposure: float
    white_border: float
    coverage: float | None
    cut: float
    across: float | None
    thumbnail: np.ndarray
    mask: np.ndarray | None = None
    backdrop: str | None = None
    half_shown: float = 0.0

    @property
    def name(self) -> str:
        return self.camera.name


def look_at_photos(
    capture: Capture, progress: Callable[[int, int], None] | None = None,
    photos: ReducedPhotos | None = None,
) -> list[Look]:  # fmt: skip
    """Look at all photos of a capture, in the cameras' order.

    Raises:
        CaptureError: one cannot be decoded.
    """
    photos, told = photos or ReducedPhotos(), progress or (lambda number, count: None)
    second = photos.find_circles(capture.cameras, lambda number, count: told(number // 2, count))
    capture = _where_told(photos, capture)
    looks = _look_at_all(
        photos, capture.cameras, capture.region, True,
        lambda number, count: told((count + number) // 2 if second else number, count),
    )  # fmt: skip
    if (cut_out := _with_common_backdrop(capture, looks)) is not None:
        return cut_out
    wrong = [look.camera for look in looks if look.backdrop is not None]
    again = iter(_look_at_all(photos, wrong, capture.region, False))
    looks = [look if look.backdrop is None else next(again) for look in looks]
    return _before_far_surroundings(photos, capture, looks) or looks


def _where_told(photos: ReducedPhotos, capture: Capture) -> Capture:
    """The capture with cameras that know where their photos say something."""
    with thread_pool(MOST_AT_ONCE) as pool:
        told = list(pool.map(photos.told, capture.cameras))
    if all(mask is None for mask in told):
        return capture
    cameras = (replace(c, told=mask) for c, mask in zip(capture.cameras, told, strict=True))
    return replace(capture, cameras=tuple(cameras))


def _before_far_surroundings(
    photos: ReducedPhotos, capture: Capture, looks: list[Look]
) -> list[Look] | None:
    """The looks, with masks of what stands out from surroundings that are far away; None: they are not, or
    photos have masks."""
    if any(look.mask is not None for look in looks):
        return None
    cameras = tuple(camera.no_larger(COMPARED) for camera in capture.cameras)
    with thread_pool() as pool:
        small = list(pool.map(partial(_small_photo, photos), capture.cameras, cameras))
    found = cut_out_before_far(at_sizes_of(small, capture), small)
    if found is None:
        return None
    masks = [photo.pixels[..., 3] > 0.5 for photo in found.photos]
    with thread_pool(MOST_AT_ONCE) as pool:
        again = pool.map(
            lambda camera, mask: look_at(camera, capture.region, shown=mask, read=photos),
            capture.cameras, masks,
        )  # fmt: skip
        return [replace(look, backdrop="far") for look in again]


def _small_photo(photos: ReducedPhotos, camera: Camera, small: Camera) -> Photo:
    colour = photos(camera)[0]
    colour = filled(colour, camera.told_at(colour.shape[:2]))
    colour = smaller(np.ascontiguousarray(colour), max(small.width, small.height))
    opaque = np.ones((*colour.shape[:2], 1), np.float32)
    return Photo(np.concatenate([TO_LINEAR[colour], opaque], axis=-1), False, False)


def _longer_side(mask: np.ndarray, camera: Camera) -> float:
    """Pixels that the box of what a mask shows measures; 0 if it shows nothing. What lies across the two
    edges of a panorama is in one piece."""
    if camera.is_panoramic:
        mask = np.roll(mask, -_middle_of_gap(mask.any(0)), axis=1)
    return float(max(np.ptp(found) + 1 for found in mask.nonzero())) if mask.any() else 0.0


def _middle_of_gap(columns: np.ndarray) -> int:
    """The middle of the longest run of false, of which the last is beside the first; 0 if there is none."""
    shown = np.flatnonzero(columns)
    if len(shown) in (0, len(columns)):
        return 0
    gaps = np.diff(shown, append=shown[0] + len(columns))
    longest = gaps.argmax()
    return int(shown[longest] + (gaps[longest] + 1) // 2) % len(columns)


def _cut_share(mask: np.ndarray, camera: Camera) -> float:
    """Share of a photo's edge that cuts off what a mask shows: a panorama goes on at its other side."""
    return 0.0 if camera.is_panoramic else border_share(mask)


def _with_common_backdrop(capture: Capture, looks: list[Look]) -> list[Look] | None:
    """The looks, with masks of what stands out from one backdrop if the fit takes it as such; else None."""
    if len({look.backdrop for look in looks}) > 1 or looks[0].backdrop is None:
        return None
    masks = [look.mask for look in looks]
    if looks[0].backdrop == "plain":
        if np.median([look.cut for look in looks]) > 1 - EVEN_BORDER:
            return None
        masks = mended(capture.cameras, masks, capture.region)
    if masks is None or not fit_together(capture.cameras, masks, capture.region):
        return None
    return [
        replace(look, mask=mask, coverage=float(mask.mean()), cut=_cut_share(mask, look.camera))
        for look, mask in zip(looks, masks, strict=True)
    ]


def _look_at_all(
    photos: ReducedPhotos, cameras: Sequence[Camera], region: np.ndarray, cut_out: bool,
    progress: Callable[[int, int], None] = lambda number, count: None,
) -> list[Look]:  # fmt: skip
    looks = []
    with thread_pool(MOST_AT_ONCE) as pool:
        for look in pool.map(lambda camera: look_at(camera, region, cut_out, read=photos), cameras):
            looks.append(look)
            progress(len(looks), len(cameras))
    return looks


def look_at(
    camera: Camera, region: np.ndarray, cut_out: bool = False, shown: np.ndarray | None = None,
    read: Callable[[Camera], tuple[np.ndarray, np.ndarray | None]] | None = None,
) -> Look:  # fmt: skip
    """Look at one photo, where it says something (`Camera.told`).

    Args:
        region: [2, 3] world box of the object.
        cut_out: without alpha and mask, what stands out from a plain backdrop is taken as such.
        shown: [H, W] bool, of any size, what is to be taken as mask.
        read: what has a camera's colour and alpha, as `load_reduced`; None: the photo is decoded.
    """
    path = camera.image_path
    colour, alpha = (read or ReducedPhotos())(camera)
    height, width = colour.shape[:2]
    told = camera.told_at((height, width))
    if told is not None:
        colour = filled(colour, told)
    if alpha is not None and (alpha if told is None else alpha[told]).min() == 255:
        alpha = None
    if camera.mask_path is not None:
        mask = load_reduced_mask(
            camera.mask_path, (height, width), (camera.width, camera.height), image_orientation(path)
        )
        alpha = mask if alpha is None else np.minimum(alpha, mask)
    if alpha is not None and told is not None:
        alpha = alpha * told
    if shown is not None:
        alpha = at_size(shown, (height, width)) * np.uint8(255)
    backdrop = None
    if alpha is None and cut_out:
        levels = colour.astype(np.float32) / 255
        backdrop = backdrop_of([border_of(levels)])
        if backdrop is not None:
            alpha = object_before(levels, backdrop) * np.uint8(255)
        elif (around := surroundings_of(levels)) is not None:
            backdrop, alpha = "plain", around.shown * np.uint8(255)
    scale = camera.width / width
    inside = np.zeros((height, width), bool)
    inside[frame_of(camera, region, scale, (height, width))] = True
    if told is not None:
        inside &= told
        inside = inside if inside.any() else told
    white = border_share((colour >= 250).all(axis=-1))
    shown, coverage, cut, across, half_shown = None, None, 0.0, None, 0.0
    detailed = inside
    if alpha is not None:
        shown = alpha > 127
        half_shown = 1 - (alpha > WHOLE).sum() / max((alpha > 255 - WHOLE).sum(), 1)
        coverage, cut = float(shown.mean()), _cut_share(shown, camera)
        across = _longer_side(shown, camera) * scale
        # Away from the mask's edge, whose sharpness and brightness are the mask's.
        detailed = without_untold(ndimage.binary_erosion(shown, iterations=2), told)
        seen = without_untold(shown, told)
        inside = detailed if detailed.sum() >= FEWEST_PIXELS else seen if seen.any() else inside
    linear = TO_LINEAR[colour] @ _LUMINANCE
    pixels = colour[inside]
    values = linear[inside]
    thumbnail = Image.fromarray(np.ascontiguousarray(colour)).resize(
        (_THUMBNAIL, _THUMBNAIL), Image.Resampling.BOX
    )
    grey = colour.astype(np.float32) @ _LUMINANCE
    return Look(
        camera, sharpness_of(grey, detailed), float((pixels >= 254).any(axis=-1).mean()),
        _middle_stops(values), white, coverage, cut, across,
        np.asarray(thumbnail).astype(np.int16), shown, backdrop, float(half_shown),
    )  # fmt: skip


def frame_of(
    camera: Camera, region: np.ndarray, scale: float, shape: tuple[int, int]
) -> tuple[slice, slice]:
    """Rows and columns of a photo reduced by `scale` that show the region; all if that is unclear."""
    corners = np.array(list(product(*region.T)))
    pixel, depth = camera.project(corners)
    if (depth <= 0).any() or not np.isfinite(pixel).all():
        return np.s_[:, :]
    if camera.is_panoramic and np.ptp(pixel[:, 0]) > camera.width / 2:
        return np.s_[:, :]  # it lies across both edges, or above or below the camera
    low = np.clip(np.floor(pixel.min(0) / scale), 0, None).astype(int)
    high = np.ceil(pixel.max(0) / scale).astype(int)
    rows, columns = slice(low[1], min(high[1], shape[0])), slice(low[0], min(high[0], shape[1]))
    few = FEWEST_PIXELS**0.5
    if rows.stop - rows.start < few or columns.stop - columns.start < few:
        return np.s_[:, :]
    return rows, columns


def _middle_stops(luminance: np.ndarray) -> float:
    """Mean log2 between the quartiles: steadier than the median where there are few tones."""
    stops = np.log2(np.maximum(luminance, 1e-4))
    low, high = np.percentile(stops, (25, 75))
    return float(stops[(stops >= low) & (stops <= high)].mean())
