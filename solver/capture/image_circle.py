"""The circle that a fisheye's image fills, where a photo shows more than that: black all around.

A lens's numbers do not tell: those of most fisheyes have rays for the black corners, too. But what is black
in all photos of one lens, and begins at one distance all around the middle, is no backdrop.
"""

import numpy as np

from .camera import Camera
from .lenses import distort

BLACK = 4 / 255 / 12.92
"""radiance, linear, up to which a pixel may be beyond the circle: four levels, for JPEG is not exact"""
STRAY = 0.02
"""share of the pixels that may be on the wrong side of its edge: glare, and what is black within"""
SOFT = 1.1
"""times the radius from which on nothing is lit, that at which all is"""
SMALLEST = 0.7
"""of half the picture's shorter side; less than that is more likely an object before black"""
INNER = 0.98
"""of the radius that counts: images fade towards their edge"""


def sees_sideways(camera: Camera) -> bool:
    """Whether a lens has rays at a right angle to its axis, as fisheyes have and no perspective lens."""
    if camera.is_panoramic:
        return False
    aside = distort(camera.lens, tuple(camera.distortion), np.array([[1.0, 0.0, 0.0]]))
    return bool(np.isfinite(aside).all())


def image_circle(camera: Camera, brightest: np.ndarray) -> np.ndarray | None:
    """[H, W] bool: what lies within the circle that the image of a fisheye fills; None: no circle is seen.

    Args:
        brightest: [H, W] linear, the greatest of all channels and photos of the lens.
    """
    height, width = brightest.shape
    row, column = np.mgrid[:height, :width] + 0.5
    radius = np.hypot(column - camera.cx * width / camera.width, row - camera.cy * height / camera.height)
    dark = brightest <= BLACK
    if not dark.any() or dark.all():
        return None
    beyond, within = np.quantile(radius[dark], STRAY), np.quantile(radius[~dark], 1 - STRAY)
    if within > SOFT * beyond or beyond < SMALLEST * 0.5 * min(height, width):
        return None
    return radius < INNER * min(beyond, within)


class Circles:
    """Gathers the photos of each lens, and tells the circles in them."""

    def __init__(self):
        self._brightest: dict[tuple, tuple[Camera, np.ndarray]] = {}

    def add(self, camera: Camera, colour: np.ndarray) -> None:
        """Take in a photo's colours [H, W, 3], linear; of a lens that is no fisheye's it does nothing."""
        key = camera.lens_key
        if key not in self._brightest and not sees_sideways(camera):
            return
        level = colour.max(-1)
        _, before = self._brightest.get(key, (camera, level))
        self._brightest[key] = camera, np.maximum(before, level)

    def found(self) -> dict[tuple, np.ndarray]:
        """`image_circle` by `Camera.lens_key`, of the lenses that have one."""
        circles = {key: image_circle(*seen) for key, seen in self._brightest.items()}
        return {key: circle for key, circle in circles.items() if circle is not None}
