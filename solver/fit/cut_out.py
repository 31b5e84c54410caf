"""Photos of an object before a plain backdrop get alpha: the fit then begins with its hull."""

from dataclasses import replace

import numpy as np

from ..capture.backdrop import LEVELS, backdrop_of, border_of, object_before
from ..capture.capture import Capture
from ..capture.panorama import Panorama
from ..capture.photos import Photo, at_sizes_of, linear_to_srgb, load_photos
from ..capture.plain_surroundings import EVEN_BORDER, surroundings_of
from .before_far import few_before_panorama
from .common_masks import fit_together, mended
from .cut_out_standing import few_on_support
from .photo_alpha import srgb_of, with_alpha
from .settings import Settings
from .standing import Standing

PROBED = 8
"""photos, evenly taken from all, that tell whether there is a plain backdrop of any colour"""


def cut_out(capture: Capture, photos: list[Photo]) -> list[Photo]:
    """Photos with the object's coverage as alpha, if none has alpha and all are before a plain backdrop.

    A part of the object that looks like what is behind it would be lost, and with it all that lies behind
    it as seen from there. Then the hull no longer holds what other photos show; photos of which that is so
    are returned as they are.

    Args:
        capture: with the object in its region.
    """
    backdrop = backdrop_behind(photos)
    if backdrop is None:
        return _from_surroundings(capture, photos)
    shown = [object_before(srgb_of(photo), backdrop) for photo in photos]
    if not fit_together(capture.cameras, shown, capture.region):
        return photos
    return [
        replace(with_alpha(photo, mask, LEVELS[backdrop]), backdrop=backdrop)
        for photo, mask in zip(photos, shown, strict=True)
    ]


def photos_as_fitted(
    capture: Capture, settings: Settings, use_masks: bool, region: np.ndarray | None,
    panorama: Panorama | None = None, standing: Standing | None = None,
) -> list[Photo]:  # fmt: skip
    """Photos to compare a fit's pictures with, loaded and cut out as those of the fit were.

    Args:
        use_masks: the fit's photos had alpha that said what is object, theirs or from being cut out.
        region: [2, 3] world box of the object; None: the capture's.
        panorama: what was far behind the object in the fit's photos.
        standing: what they told of the object and what it stands on.

    Raises:
        CaptureError: a photo cannot be used.
    """
    photos = load_photos(capture, settings=settings.photos)
    capture = at_sizes_of(photos, capture)
    if region is not None:
        capture = replace(capture, region=region)
    if not (settings.fit.cut_out and use_masks) or any(photo.has_alpha for photo in photos):
        return photos
    if panorama is not None:
        return few_before_panorama(capture.cameras, photos, panorama, capture.region)
    if standing is not None:
        return few_on_support(capture.cameras, photos, standing)
    return cut_out_of_colour(capture, photos)


def cut_out_of_colour(capture: Capture, photos: list[Photo]) -> list[Photo]:
    """As `cut_out`, but photos before white or black stay as they are: pictures of a fit have these behind
    the object, too, and no other colour."""
    if backdrop_behind(photos) is not None:
        return photos
    return _from_surroundings(capture, photos)


def _from_surroundings(capture: Capture, photos: list[Photo]) -> list[Photo]:
    """As `cut_out`, before a plain backdrop that is neither white nor black."""
    if any(photo.has_alpha for photo in photos):
        return photos
    probed = [surroundings_of(srgb_of(p)) for p in photos[:: max(1, len(photos) // PROBED)]]
    if np.median([0.0 if found is None else found.share for found in probed]) < EVEN_BORDER:
        return photos
    around = [surroundings_of(srgb_of(photo)) for photo in photos]
    if any(found is None for found in around):
        return photos
    shown = mended(capture.cameras, [found.shown for found in around], capture.region)
    if shown is None or not fit_together(capture.cameras, shown, capture.region):
        return photos
    return [
        with_alpha(photo, mask, found.behind)
        for photo, mask, found in zip(photos, shown, around, strict=True)
    ]


def backdrop_behind(photos: list[Photo]) -> str | None:
    """'white' or 'black', if that is plainly behind the object in photos without alpha; else None."""
    if any(photo.has_alpha for photo in photos):
        return None
    return backdrop_of([_border(photo) for photo in photos])


def _border(photo: Photo) -> np.ndarray:
    """Colours [N, 3] sRGB along a photo's edges."""
    if photo.told is None:
        return linear_to_srgb(border_of(photo.pixels[..., :3]))
    return border_of(srgb_of(photo))
