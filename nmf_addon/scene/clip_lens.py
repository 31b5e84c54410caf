"""The lens of Blender's tracker as the solver's.

Formulas are those of libmv's `distortion_models.cc`, with y up and distances from the centre in units of
the focal length; NUKE's are in halves of the picture's longer side. r is ideal, d in the picture:

    POLYNOMIAL, BROWN    d = r (1 + k1 r² + k2 r⁴ + …)
    DIVISION             d = r / (1 + k1 r² + k2 r⁴)
    NUKE                 r = d / (1 + k1 d² + k2 d⁴)
"""

import bpy
import numpy as np

from ...solver.capture.brown_lens import polynomial_lens

_RADII = 200
"""radii at which a lens that has no formula in the solver is fitted"""


def lens_of(clip: bpy.types.MovieClip) -> tuple[str, tuple[float, ...]]:
    """Lens and distortion (`Camera.lens`, `Camera.distortion`) of a movie clip."""
    camera = clip.tracking.camera
    model = camera.distortion_model
    if model == "POLYNOMIAL":
        return polynomial_lens((camera.k1, camera.k2, camera.k3))
    if model == "BROWN":
        radial = (camera.brown_k1, camera.brown_k2, camera.brown_k3, camera.brown_k4)
        # libmv has OpenCV's tangential terms in the other order, and y up.
        return polynomial_lens(radial, (-camera.brown_p2, camera.brown_p1))
    if model == "DIVISION":
        below = (camera.division_k1, camera.division_k2)
        return ("opencv", (0.0, 0.0, 0.0, 0.0, 0.0, *below)) if any(below) else ("pinhole", ())
    half = max(clip.size) / 2 / camera.focal_length_pixels
    k1, k2 = camera.nuke_k1 / half**2, camera.nuke_k2 / half**4
    if k2 == 0:
        return ("division", (k1,)) if k1 else ("pinhole", ())
    return polynomial_lens(_fitted(k1, k2, np.hypot(*clip.size) / 2 / camera.focal_length_pixels))


def _fitted(k1: float, k2: float, corner: float) -> list[float]:
    """k1 … k4 of a polynomial that does what r = d / (1 + k1 d² + k2 d⁴) does, up to an image radius."""
    image = np.linspace(corner / _RADII, corner, _RADII)
    ideal = image / (1 + k1 * image**2 + k2 * image**4)
    powers = ideal[:, None] ** np.array([3, 5, 7, 9])
    return np.linalg.lstsq(powers, image - ideal, rcond=None)[0].tolist()
