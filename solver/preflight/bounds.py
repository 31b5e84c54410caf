"""Where the object is, as all masks together tell: the box that the region could shrink to."""

import numpy as np

from ..capture.capture import Capture
from ..fit.visual_hull import BELONG_TOGETHER, NOTHING_IN_COMMON, hull_box
from .findings import Finding, warning
from .looks import Look

CELLS = 64


def object_box(capture: Capture, looks: list[Look], margin: float) -> np.ndarray | None:
    """Box [2, 3] of the capture's region that no mask shows as background, with room around it.

    None where a photo has no mask, or masks have nothing in common within the region.

    Args:
        margin: that room, as a share of the box's longest side.
    """
    masks = [look.mask for look in looks]
    if any(mask is None for mask in masks):
        return None
    box = hull_box([look.camera for look in looks], lambda: masks, capture.region, CELLS)
    if box is None:
        return None
    room = margin * (box[1] - box[0]).max()
    return np.stack([box[0] - room, box[1] + room])


def nothing_in_common(looks: list[Look], box: np.ndarray | None) -> list[Finding]:
    """A warning where every photo has a mask and there is still no box."""
    if box is not None or any(look.mask is None or not look.coverage for look in looks):
        return []
    return [warning(f"{NOTHING_IN_COMMON}; {BELONG_TOGETHER}")]
