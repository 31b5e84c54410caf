"""Where the object is, as all masks together tell: the box that the region could shrink to."""

from __future__ import annotations

import numpy as np

from ..capture.capture import Capture
from ..fit.visual_hull import SEEN_BY, bounding_box, carve
from .findings import Finding, warning
from .looks import Look

CELLS = 64
MARGIN = 0.08
"""room around the hull, as a share of its longest side"""


def object_box(capture: Capture, looks: list[Look]) -> np.ndarray | None:
    """Box [2, 3] of the capture's region that no mask shows as background, with a margin.

    None where a photo has no mask, or masks have nothing in common within the region.
    """
    masks = [look.mask for look in looks]
    if any(mask is None for mask in masks):
        return None
    cameras = [look.camera for look in looks]
    hull = carve(cameras, masks, capture.region, CELLS, SEEN_BY)
    if not hull.any():
        return None
    # Once more within what is left, where cells are finer.
    coarse = bounding_box(hull, capture.region)
    edge = (capture.region[1] - capture.region[0]) / CELLS
    coarse = np.stack([coarse[0] - edge, coarse[1] + edge])
    fine = carve(cameras, masks, coarse, CELLS, SEEN_BY)
    box = bounding_box(fine, coarse) if fine.any() else coarse
    margin = MARGIN * (box[1] - box[0]).max()
    return np.stack([box[0] - margin, box[1] + margin])


def nothing_in_common(looks: list[Look], box: np.ndarray | None) -> list[Finding]:
    """A warning where every photo has a mask and there is still no box."""
    if box is not None or any(look.mask is None or not look.coverage for look in looks):
        return []
    return [
        warning(
            "no point in the region lies inside the masks of all photos; check that masks and cameras "
            "belong together, or enlarge the region"
        )
    ]
