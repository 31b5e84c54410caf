"""Whether photos fit their cameras, by what some pairs of them have in common."""

from __future__ import annotations

import numpy as np

from ..capture.agreement import another_convention
from ..capture.capture import Capture, evenly_taken
from ..capture.photo_matches import LONGEST, grey_of, neighbours
from ..capture.refine import TOLERATED
from ..capture.triangulate import compare
from ..fit.settings import Settings
from ..job.apart import ApartError
from .findings import Finding, note, warning
from .looks import ReducedPhotos

PAIRS = 12
"""that are compared: some seconds"""
NEAREST = 2
"""of a camera's neighbours, that it may be compared with"""


def poses(capture: Capture, photos: ReducedPhotos, settings: Settings) -> list[Finding]:
    """How far photos lie beside their cameras, if they have enough in common to tell."""
    cameras = capture.cameras
    near = neighbours(list(cameras), NEAREST)
    if not near:
        return []
    pairs = [near[i] for i in evenly_taken(len(near), PAIRS)]
    chosen = sorted({index for pair in pairs for index in pair})
    place = {index: number for number, index in enumerate(chosen)}
    pictures = [grey_of(np.ascontiguousarray(photos(cameras[i])[0])) for i in chosen]
    try:
        found = compare(
            [cameras[i] for i in chosen], pictures, [(place[i], place[j]) for i, j in pairs],
            lambda done: None,
        )  # fmt: skip
    except ApartError:
        return []
    if found.beside is None:
        return []
    if found.remedy is not None:
        return [warning(f"{another_convention(found.beside)}; {found.remedy}")]
    told = f"photos lie {found.beside:.1f} pixels (of {LONGEST}) beside their cameras"
    if found.beside < TOLERATED:
        return [note(told)]
    if settings.fit.refine_cameras and capture.has_few_points:
        return [warning(f"{told}; these will be adjusted to them, as far as photos tell")]
    return [warning(f"{told}, and will be blurred; solve cameras from these photos anew")]
