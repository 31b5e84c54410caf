"""A job's surroundings.exr: what photos show far behind the object, and where they do."""

from pathlib import Path

import numpy as np

from ..asset.files import write_exr
from ..capture.colour import linear_to_srgb, srgb_to_linear
from ..capture.panorama import Panorama
from ..capture.photos import read_exr


def write_panorama(path: Path, panorama: Panorama) -> None:
    """Write a panorama of sRGB colours as linear Rec.709, Blender's equirectangular convention; alpha is 1
    where it is known."""
    linear = srgb_to_linear(panorama.colour)
    write_exr(path, {"RGBA": np.concatenate([linear, panorama.known[..., None]], axis=-1)})


def read_panorama(path: Path) -> Panorama | None:
    """That panorama; None if there is none.

    Raises:
        CaptureError: it cannot be read.
    """
    if not path.is_file():
        return None
    linear, alpha = read_exr(path)
    return Panorama(linear_to_srgb(linear).astype(np.float32), alpha > 0.5)
