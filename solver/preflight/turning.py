"""Whether the object was turned, and not the camera carried around it: then the light turned as well."""

from ..fit.turned_light import Circles
from .findings import Finding, note


def turning(circles: Circles | None) -> list[Finding]:
    """A note on a capture whose cameras stand on circles, as those of a turntable do."""
    if circles is None or circles.still is False:
        return []
    if circles.still:
        return [
            note("the object was turned in front of a still camera: the light will go round with the "
                 "cameras (if it was the camera that moved, set Turntable to No, light.turntable=no)")
        ]  # fmt: skip
    return [
        note("the cameras stand on exact circles: if the object was turned in front of a still camera, set "
             "Turntable to Yes (light.turntable=yes), since its light turned as well")
    ]  # fmt: skip
