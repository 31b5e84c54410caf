"""Copies of photos that Blender can show, where it cannot show the photos."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from ..capture.camera import Camera
from ..capture.capture import Capture
from ..capture.errors import CaptureError
from ..capture.image_header import blender_shows
from ..capture.photos import MOST_AT_ONCE
from ..capture.reduced import load_reduced
from ..threads import thread_pool

LONGEST = 800
"""pixels of a copy's longer side, at most"""


def write_pictures(capture: Capture, folder: Path, tell: Callable[[int, int], None]) -> dict[str, str]:
    """Write a small copy of each HEIC, AVIF and raw photo of a capture, as its camera saw it.

    Args:
        folder: new or empty.
        tell: called after each with how many are done, of how many; what it raises ends it.

    Returns:
        the copies' paths by those of their photos: PNG if there is alpha, else JPEG; sRGB.

    Raises:
        CaptureError: a photo cannot be decoded, or something lies in the folder.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if any(folder.iterdir()):
        raise CaptureError(folder, "out", "it is not empty", "give a new folder")
    photos = ((camera, camera.image_path) for camera in capture.cameras)
    hidden = [camera for camera, path in photos if path is not None and not blender_shows(path)]
    pictures = {}
    with thread_pool(MOST_AT_ONCE) as pool:
        written = pool.map(lambda camera: _write(camera, folder), hidden)
        try:
            for number, (camera, picture) in enumerate(zip(hidden, written, strict=True), start=1):
                pictures[str(camera.image_path)] = str(picture)
                tell(number, len(hidden))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return pictures


def _write(camera: Camera, folder: Path) -> Path:
    colour, alpha = load_reduced(camera.image_path, LONGEST, (camera.width, camera.height))
    if alpha is None:
        path = folder / f"{camera.name}.jpg"
        Image.fromarray(np.ascontiguousarray(colour)).save(path, quality=92)
    else:
        path = folder / f"{camera.name}.png"
        Image.fromarray(np.dstack([colour, alpha])).save(path)
    return path
