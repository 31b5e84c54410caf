"""By how much a camera has to move so that what is rendered looks like its photo.

A picture's pixels shift with its camera as far as the depth of what they show says, so its slopes tell how
it changes: Lucas & Kanade's alignment (1981) in the six numbers of a motion, as direct odometry has it
(Engel et al. 2018, doi:10.1109/TPAMI.2017.2658577). Slopes are the mean of both pictures', which makes a
step right to second order (Benhimane & Malis 2004, doi:10.1109/IROS.2004.1389474).

A motion [6] is in camera axes: a turn (rad), then a shift in units of the object's distance. Of a turn and
a shift the other way, which shows the object from a little aside, pictures tell little.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import ndimage
from scipy.spatial.transform import Rotation

from ..capture.camera import Camera
from ..capture.frames import rigid
from .preview import over_plain

BLUR = 1.0
"""pixels, of both pictures: slopes hold for about as far"""
DEPTH_BLUR = 2.0
"""pixels, of the depth: outlines need one on their outer side, too"""
LEAST_OPACITY = 0.02
"""from which on a pixel is of the object"""
OUTLIER, QUANTIZED = 2.0, 0.02
"""a channel's difference that counts for half: in medians of it, and what is added to that"""
FEWEST_PIXELS, NO_STEP = 50, 1e-12


class Evidence(NamedTuple):
    """What a photo says about its camera's motion: the normal equations of least squares."""

    information: np.ndarray  # [6, 6], of differences measured in a channel's usual one
    towards: np.ndarray  # [6]
    shifts: np.ndarray  # [N, 2, 6] pixels by which pixels (columns, rows) of the object shift with a motion

    def pixels(self, motion: np.ndarray) -> float:
        """By how much a motion [6] shifts the object's pixels, root mean square."""
        return float(((self.shifts @ motion) ** 2).sum(1).mean() ** 0.5)


def comparable(premultiplied: np.ndarray) -> np.ndarray:
    """Blurred sRGB over black, and opacity [H, W, 4], of linear premultiplied RGBA [H, W, 4]."""
    shown = np.dstack([over_plain(premultiplied, "black"), premultiplied[..., 3].clip(0, 1)])
    return ndimage.gaussian_filter(shown, (BLUR, BLUR, 0))


def evidence(
    photo: np.ndarray, rendered: np.ndarray, opacity: np.ndarray, distance: np.ndarray,
    directions: np.ndarray, away: float, told: np.ndarray | None = None,
) -> Evidence | None:  # fmt: skip
    """What a photo says about the motion by which its camera is to be moved; None: it shows too little.

    Args:
        photo, rendered: [H, W, 4] (see `comparable`).
        opacity: [H, W] as rendered. distance: [H, W] along the rays, times opacity, world units.
        directions: [H, W, 3] unit, through the pixels' centres, in camera axes.
        away: the object's distance, world units.
        told: [H, W] bool, false where the photo says nothing; None: it says something everywhere.
    """
    cover = ndimage.gaussian_filter(opacity, DEPTH_BLUR)
    used = (np.maximum(photo[..., 3], rendered[..., 3]) > LEAST_OPACITY) & (cover > LEAST_OPACITY)
    if told is not None:
        used &= ndimage.binary_erosion(told, iterations=math.ceil(2 * BLUR), border_value=1)
    if used.sum() < FEWEST_PIXELS:
        return None
    depth = ndimage.gaussian_filter(distance, DEPTH_BLUR)[used] / cover[used]
    shifts = _shifts(directions, depth / away, used)
    down, across = np.gradient(0.5 * (photo + rendered), axis=(0, 1))
    slopes = np.stack([across[used], down[used]], axis=-1)
    changes = slopes @ shifts
    difference = (photo - rendered)[used]
    usual = OUTLIER * np.median(np.abs(difference), axis=0) + QUANTIZED
    weights = 1 / (1 + (difference / usual) ** 2) / usual**2
    weighed = (weights[..., None] * changes).reshape(-1, 6)
    return Evidence(weighed.T @ changes.reshape(-1, 6), weighed.T @ difference.ravel(), shifts)


def _shifts(directions: np.ndarray, depth: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Pixels (columns, rows) [N, 2, 6] by which pictures of a moved camera have to be shifted to lie on the
    one as it is, for points at depths [N] in units of the object's; whatever the lens."""
    down, across = np.gradient(directions, axis=(0, 1))
    steps = np.stack([across[used], down[used]], axis=-1)
    x, y, z = directions[used].T
    none = np.zeros_like(x)
    turns = np.array([[none, z, -y], [-z, none, x], [y, -x, none]]).transpose(2, 0, 1)
    moves = np.concatenate([turns, np.eye(3) / depth[:, None, None]], axis=-1)
    # A direction's change in steps from pixel to pixel, by least squares; beyond a lens there are none.
    back = steps.transpose(0, 2, 1)
    return np.linalg.solve(back @ steps + NO_STEP * np.eye(2), back @ moves)


def moved(camera: Camera, motion: np.ndarray, away: float) -> Camera:
    """A camera after a motion [6], its object being `away`, world units."""
    turn = Rotation.from_rotvec(motion[:3]).as_matrix()
    return replace(camera, camera_to_world=camera.camera_to_world @ rigid(turn, motion[3:] * away))
