"""Whether an object was turned before a still camera, so that its light goes round with the cameras."""

from __future__ import annotations

from ..capture.capture import Capture
from ..capture.errors import CaptureError
from ..capture.reduced import load_reduced
from ..capture.turntable import ON_STANDS, Turntable, stands_of, stands_still
from .errors import SettingsError

LONGEST = 64
"""pixels of photos whose edges are compared"""


def turntable_of(capture: Capture, wanted: str) -> Turntable | None:
    """The turntable that a capture's object was on, in the capture's world; None: its light stood still.

    Args:
        wanted: `LightSettings.turntable`.

    Raises:
        SettingsError: there has to be one, but the cameras go round no axis.
    """
    if wanted == "no":
        return None
    stands = stands_of(capture.cameras)
    if wanted == "yes":
        if stands is None or stands.share == 0:
            raise SettingsError(
                "Setting 'light.turntable': these cameras do not stand on circles about an axis, as those "
                "of a turntable do; choose no."
            )
        return stands.turntable
    shown = all(camera.image_path is not None for camera in capture.cameras)
    if stands is None or stands.share < ON_STANDS or not shown:
        return None
    try:
        photos = [
            load_reduced(camera.image_path, LONGEST, (camera.width, camera.height))[0]
            for camera in capture.cameras
        ]
    except CaptureError:
        # A format that only the fit decodes.
        return None
    return stands.turntable if stands_still(photos, stands.of_photo) else None
