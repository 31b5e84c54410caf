"""What photos with mask files show around the object, which tells where their cameras stand.

The object does not: it may be a mirror, in which nothing is where it seems to be.
"""

from __future__ import annotations

import numpy as np
import scipy.ndimage

from .camera import Camera
from .image_header import image_orientation
from .photo_matches import LONGEST, Picture, picture_from
from .reduced import load_reduced, load_reduced_mask

TOLERATED_AROUND = 1.5
"""pixels by which photos may lie beside their cameras, of pictures that features were sought in, where the
object does not count: of a floor that is seen at a slant in small photos, right cameras have 1.0"""
FAINT = 12
"""of 255, up to which a mask is black: JPEG is not exact"""
BORDER = 0.01
"""of the picture's longer side: so far around a mask nothing is looked at"""


def picture_around(camera: Camera) -> Picture:
    """A photo that has a mask file, with the object hidden.

    Raises:
        CaptureError: photo or mask cannot be read.
    """
    colour, _ = load_reduced(camera.image_path, LONGEST, (camera.width, camera.height))
    mask = load_reduced_mask(
        camera.mask_path, colour.shape[:2], image_orientation(camera.image_path)
    )
    width = 2 * round(BORDER * max(mask.shape)) + 1
    hidden = scipy.ndimage.maximum_filter(mask > FAINT, width)
    return picture_from(np.ascontiguousarray(colour), hidden)
