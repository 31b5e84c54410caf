"""Whether photos fit their cameras, by what some pairs of them have in common."""

from collections.abc import Callable

import numpy as np

from ..apart import ApartError
from ..capture.agreement import another_convention
from ..capture.camera import Camera
from ..capture.capture import Capture
from ..capture.photo_matches import LONGEST, Picture, hidden_around, picture_from
from ..capture.refine import TOLERATED
from ..capture.surroundings import TOLERATED_AROUND, picture_around
from ..capture.triangulate import compare_some
from ..fit.before_far import at_size
from ..fit.settings import Settings
from .findings import Finding, note, warning
from .reduced_photos import ReducedPhotos


def poses(
    capture: Capture, photos: ReducedPhotos, settings: Settings, progress: Callable[[float], None]
) -> list[Finding]:
    """How far photos lie beside their cameras, if they have enough in common to tell."""
    masked = all(camera.mask_path is not None for camera in capture.cameras)

    def picture_of(camera: Camera) -> Picture:
        if masked:
            return picture_around(camera)
        colour, told = photos(camera)[0], photos.told(camera)
        hidden = None
        if told is not None:
            hidden = hidden_around(~at_size(told, colour.shape[:2]))
        return picture_from(np.ascontiguousarray(colour), hidden)

    try:
        found = compare_some(capture.cameras, picture_of, progress)
    except ApartError:
        return []
    if found.beside is None:
        return []
    if found.remedy is not None:
        return [warning(f"{another_convention(found.beside)}; {found.remedy}")]
    told = f"photos and cameras disagree by {found.beside:.1f} pixels (of {LONGEST})"
    if found.beside < (TOLERATED_AROUND if masked else TOLERATED):
        return [note(told)]
    if settings.fit.refine_cameras and capture.has_few_points:
        return [warning(f"{told}; the cameras will be adjusted, as far as photos tell")]
    return [warning(f"{told}, which blurs the result; solve cameras from these photos")]
