"""Photos as a check looks at them: at a reduced size, decoded once, and where they say something."""

from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np

from ..capture.camera import Camera
from ..capture.image_circle import Circles, sees_sideways
from ..capture.photos import srgb_to_linear
from ..capture.reduced import load_reduced
from ..capture.told import both, check_told, told_of_reduced
from ..fit.before_far import at_size
from ..threads import mapped_ahead, thread_pool

LONGEST = 960
"""pixels of the longer side that is looked at: a quarter of a phone photo's, which JPEG decodes fast"""
MOST_KEPT = 1 << 28
"""bytes of photos without masks that are kept to be asked for again: HEIC takes a second each time"""
MOST_AT_ONCE = 8
"""photos that are looked at at once, as many threads, at most"""
TO_LINEAR = srgb_to_linear(np.arange(256) / 255).astype(np.float32)
"""[256] linear, of sRGB's levels"""


class ReducedPhotos:
    """Photos at the size that is looked at, as `load_reduced` has them.

    Those without masks, which are asked for again, are decoded once as long as `MOST_KEPT` lasts.
    """

    def __init__(self):
        self._kept: dict[tuple[Path | None, int, int], np.ndarray] = {}
        self._left = MOST_KEPT
        self._circles: dict[tuple, np.ndarray] = {}

    def __call__(self, camera: Camera) -> tuple[np.ndarray, np.ndarray | None]:
        """Colour [H, W, 3] uint8 sRGB and alpha [H, W] uint8 or None."""
        seen = camera.width, camera.height
        if (kept := self._kept.get((camera.image_path, *seen))) is not None:
            return kept, None
        colour, alpha = load_reduced(camera.image_path, LONGEST, seen)
        if alpha is None and camera.mask_path is None and colour.nbytes <= self._left:
            self._left -= colour.nbytes
            self._kept[camera.image_path, *seen] = colour
        return colour, alpha

    def find_circles(self, cameras: Sequence[Camera], progress: Callable[[int, int], None]) -> bool:
        """Find the circles that fisheyes' images fill, as `load_photos` does: of photos without alpha, by
        all of each lens. `told` knows them from then on.

        Args:
            progress: called with the number of photos looked at and of all.

        Returns:
            Whether photos were looked at; none are where there are no fisheyes.

        Raises:
            CaptureError: a photo cannot be decoded.
        """
        if not any(map(sees_sideways, cameras)) or any(camera.mask_path for camera in cameras):
            return False
        circles = Circles()
        with thread_pool(MOST_AT_ONCE) as pool, closing(mapped_ahead(pool, self, cameras)) as photos:
            pairs = zip(cameras, photos, strict=True)
            for number, (camera, (colour, alpha)) in enumerate(pairs, start=1):
                if alpha is not None and not self._is_opaque(camera, alpha):
                    return True
                if sees_sideways(camera):
                    circles.add(camera, TO_LINEAR[colour])
                progress(number, len(cameras))
        self._circles = circles.found()
        return True

    def _is_opaque(self, camera: Camera, alpha: np.ndarray) -> bool:
        """Whether alpha [H, W] says nothing where a photo does."""
        told = self.told(camera)
        return bool((alpha if told is None else alpha[at_size(told, alpha.shape)]).min() == 255)

    def told(self, camera: Camera) -> np.ndarray | None:
        """[H, W] bool: where a photo says something, at a size like its own here; None: everywhere.

        Raises:
            CaptureError: as `told_of_reduced`.
        """
        scale = min(1.0, LONGEST / max(camera.width, camera.height))
        shape = tuple(max(1, round(scale * side)) for side in (camera.height, camera.width))
        told = told_of_reduced(camera, shape)
        if (circle := self._circles.get(camera.lens_key)) is not None:
            told = both(told, at_size(circle, shape))
            check_told(camera, told)
        return told
