"""Which way is up in a capture: what its file says, else how people hold cameras and walk with them.

Structure from motion leaves it open. People hold cameras level, mostly upright, seldom look straight up
or down, and walk around a thing rather than over it.
"""

import numpy as np

from .camera import Camera
from .capture import Capture
from .errors import CaptureError
from .frames import texel_directions, unit
from .image_header import image_orientation, image_size
from .orientation import UPWARD, lies_on_its_side

ROWS = 24
"""of the map of directions that are tried first, 7.5° apart"""
CAMERAS = 500
"""at most, by which these are judged"""
ON_ITS_SIDE, UPSIDE_DOWN = 0.25, 1.0
"""what a camera held so counts, as sines of roll: most are not"""
STEEP, TOO_STEEP = 0.9, 0.5
"""sine of the slope from which looking up or down counts, and what straight up or down does"""
CLIMB = 0.2
"""what a way of the cameras that only goes up and down counts"""
LEAST_SLOPE = 0.3
"""sine of the angle between up and the line of sight, at least, by which rolls are told: else from noise"""
LEVEL = 0.35
"""sine of the roll, at most, at which a camera counts as held level"""
PRIOR = 1e-2
"""of the pictures' mean upward direction against one camera's level axis, where sights are so alike that
these leave the slope open: shakes of 3° against slopes of 30°, squared"""


def up_of(capture: Capture) -> np.ndarray:
    """Unit world direction [3] that is up: what the file says, else `estimate_up`."""
    return unit(estimate_up(list(capture.cameras)) if capture.up is None else capture.up)


def estimate_up(cameras: list[Camera]) -> np.ndarray:
    """Unit world direction [3] that is up, from how cameras are held and where they go.

    The likeliest of directions all around, then the least squares of what each camera has level. Photos on
    their sides count nearly as much as upright ones. Its sign is that of the upper edges of photos held
    level, and the one that lets cameras look down.
    """
    pictures = np.concatenate([_pictures(camera) for camera in cameras])
    across, upward, forward, positions = np.moveaxis(pictures, 1, 0)
    some = slice(None, None, -(-len(pictures) // CAMERAS))
    guesses = texel_directions(ROWS, 2 * ROWS).reshape(-1, 3)
    judged = _unlikely(guesses, across[some], upward[some], forward[some], positions[some])
    best = guesses[np.argmin(judged)]
    for _ in range(10):
        level, rolled = _rolls(best[None], across, upward, forward)
        on_side = rolled < level
        held = np.where(on_side, across * np.sign(across @ best)[:, None], upward)
        mean_up = unit(held.mean(0) + 1e-9 * best)
        axes = np.where(on_side, upward, across)
        residual = np.abs(axes @ best)
        # Cauchy's weights: one that is far from level hardly counts.
        trust = 1 / (1 + np.square(residual / max(2 * float(np.median(residual)), 1e-6)))
        system = (trust * axes.T) @ axes - PRIOR * np.outer(mean_up, mean_up)
        found = np.linalg.eigh(system)[1][:, 0]
        best = found if found @ best >= 0 else -found
    held_level = np.abs(across @ best) < LEVEL
    vote = (upward @ best)[held_level].sum() - (forward @ best).sum()
    return best if vote >= 0 else -best


def _unlikely(
    guesses: np.ndarray, across: np.ndarray, upward: np.ndarray, forward: np.ndarray, positions: np.ndarray
) -> np.ndarray:
    """How unlikely each of the unit `guesses` [G, 3] is to be up [G], by pictures' axes and lines of sight
    and cameras' positions, [N, 3] each."""
    level, rolled = _rolls(guesses, across, upward, forward)
    slope = np.abs(forward @ guesses.T)
    steep = TOO_STEEP * np.maximum(slope - STEEP, 0) / (1 - STEEP)
    cost = (np.minimum(level, rolled) + steep).mean(0)
    way = positions - positions.mean(0)
    walked = np.square(way).sum()
    return cost + CLIMB * np.square(way @ guesses.T).sum(0) / walked if walked > 0 else cost


def _rolls(
    guesses: np.ndarray, across: np.ndarray, upward: np.ndarray, forward: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """How far pictures are from level [N, G] if they are upright, and if they lie on their sides: the
    roll's sine, and what such a camera counts."""
    slope = np.sqrt(np.maximum(1 - np.square(forward @ guesses.T), LEAST_SLOPE**2))
    upright = upward @ guesses.T
    level = np.abs(across @ guesses.T) / slope + UPSIDE_DOWN * (upright < 0)
    return level, np.abs(upright) / slope + ON_ITS_SIDE


def _pictures(camera: Camera) -> np.ndarray:
    """World directions right, up and ahead, and the place, [P, 4, 3], of a camera as one that looks ahead.

    A panorama is level all around, whatever is in its middle: it counts as two, a quarter turn apart.
    """
    right, up = _right_and_up(camera)
    ahead, place = camera.view_direction, camera.position
    pictures = [(right, up, ahead, place)]
    if camera.is_panoramic:
        pictures.append((-ahead, up, right, place))
    return np.array(pictures)


def _right_and_up(camera: Camera) -> np.ndarray:
    """World directions [2, 3] that are right and up in a camera's photo as people see it: where only the
    header says how it was held, it lies otherwise in its file, and so does its camera."""
    x, y = UPWARD.get(_orientation_in_file(camera), (0, 1))
    right, up = camera.camera_to_world[:3, 0], camera.camera_to_world[:3, 1]
    return np.stack([y * right - x * up, x * right + y * up])


def _orientation_in_file(camera: Camera) -> int:
    """EXIF's orientation, 1 to 8, by which a photo would have to be turned to stand as it was held; 1 where
    its camera is already that of the turned photo."""
    path = camera.image_path
    if path is None:
        return 1
    orientation = image_orientation(path)
    if orientation < 5:
        return orientation
    try:
        turned = lies_on_its_side(image_size(path), camera.width, camera.height)
    except CaptureError:
        return 1
    return 1 if turned else orientation
