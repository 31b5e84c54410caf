"""Whether the white balance of raw photos is one: a camera that chose it anew gave things other colours."""

import numpy as np

from ..capture.capture import Capture
from ..capture.image_header import is_raw
from ..capture.raw import as_shot_white
from ..threads import thread_pool
from .findings import Finding, warning

DIFFERENT = 0.03
"""share by which red or blue, against green, differ where the white balance was not locked"""
LOOKED_AT = 16
"""photos at most, spread over the capture: what they say is packed with their pixels"""


def white_balance(capture: Capture) -> list[Finding]:
    """A warning if raw photos of a capture are balanced differently, or not all photos are raw.

    Raises:
        CaptureError: one cannot be read.
    """
    raw = [c.image_path for c in capture.cameras if c.image_path is not None and is_raw(c.image_path)]
    count = sum(camera.image_path is not None for camera in capture.cameras)
    if 0 < len(raw) < count:
        return [
            warning(f"{len(raw)} of {count} photos are raw, which have other colors; give all as one kind")
        ]
    with thread_pool(4) as pool:
        whites = list(pool.map(as_shot_white, raw[:: -(-len(raw) // LOOKED_AT) or 1]))
    known = np.array([white for white in whites if white is not None])
    if len(known) < 2 or (most := (known.max(0) / known.min(0) - 1).max()) < DIFFERENT:
        return []
    return [
        warning(f"the camera's white balance differs by up to {most:.0%} between raw photos; set Exposure "
                "to Even Out with Color (fit.exposure=white_balance), and lock it next time")
    ]  # fmt: skip
