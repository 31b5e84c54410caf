"""Whether an object was turned before a still camera, so that its light goes round with the cameras."""

from typing import NamedTuple

from ..capture.capture import Capture
from ..capture.errors import CaptureError
from ..capture.reduced import load_reduced
from ..capture.turntable import ON_STANDS, Stands, Turntable, stands_of, stands_still
from ..capture.upright import up_of
from .errors import SettingsError

LONGEST = 64
"""pixels of photos whose edges are compared"""
MANY = 0.5
"""share of the photos that stand on circles, from which on these say where the axis is"""


class Circles(NamedTuple):
    """Circles that all but a few cameras of a capture stand on.

    Attributes:
        stands: where the cameras would have stood, had the object been turned.
        still: what is beside the object never moves; None: nothing is to be seen there.
    """

    stands: Stands
    still: bool | None


def circles_of(capture: Capture) -> Circles | None:
    """The circles of a capture's cameras, and whether its photos say that it was the object that turned;
    None: they stand on no circles."""
    stands = stands_of(capture.cameras)
    if stands is None or stands.share < ON_STANDS:
        return None
    if any(camera.image_path is None for camera in capture.cameras):
        return Circles(stands, None)
    try:
        photos = [
            load_reduced(camera.image_path, LONGEST, (camera.width, camera.height))[0]
            for camera in capture.cameras
        ]
    except CaptureError:
        # A photo that nobody can read is told of where it is needed.
        return Circles(stands, None)
    return Circles(stands, stands_still(photos, stands.of_photo))


def turntable_of(capture: Capture, wanted: str) -> Turntable | None:
    """The turntable that a capture's object was on, in the capture's world; None: its light stood still.

    Args:
        wanted: `LightSettings.turntable`.

    Raises:
        SettingsError: there has to be one, but it cannot be told about which axis.
    """
    if wanted == "no":
        return None
    if wanted == "auto":
        circles = circles_of(capture)
        return circles.stands.turntable if circles and circles.still else None
    stands = stands_of(capture.cameras)
    if stands is not None and stands.share >= MANY:
        return stands.turntable
    # The camera was held in a hand: the object turned about what is up, where all cameras look.
    first = capture.cameras[0].position
    found = Turntable.through(up_of(capture), capture.region.mean(0), first)
    if found is None:
        raise SettingsError(
            "Setting 'light.turntable': the first photo was taken from straight above, so it does not "
            "show where the light was; put another first, or choose no."
        )
    return found
