"""What photos with mask files show around the object, which tells where their cameras stand.

The object does not: it may be a mirror, in which nothing is where it seems to be.
"""

import numpy as np

from .camera import Camera
from .image_header import image_orientation
from .photo_matches import LONGEST, Picture, hidden_around, picture_from
from .reduced import load_reduced, load_reduced_mask
from .told import FAINT, told_of_reduced

TOLERATED_AROUND = 1.5
"""pixels by which photos may lie beside their cameras, of pictures that features were sought in, where the
object does not count: of a floor that is seen at a slant in small photos, right cameras have 1.0"""


def picture_around(camera: Camera) -> Picture:
    """A photo that has a mask file, with the object hidden, and what says nothing.

    Raises:
        CaptureError: photo or mask cannot be read.
    """
    size = camera.width, camera.height
    colour, _ = load_reduced(camera.image_path, LONGEST, size)
    mask = load_reduced_mask(camera.mask_path, colour.shape[:2], size, image_orientation(camera.image_path))
    hidden, told = mask > 255 * FAINT, told_of_reduced(camera, mask.shape)
    if told is not None:
        hidden |= ~told
    return picture_from(np.ascontiguousarray(colour), hidden_around(hidden))
