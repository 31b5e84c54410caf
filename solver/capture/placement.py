"""Stand a capture upright, at a size and place that suit a scene; structure from motion leaves all open."""

import math
from dataclasses import replace

import numpy as np

from .capture import Capture, region_seen_by
from .frames import scale_and_rotation, unit
from .upright import up_of

UP = np.array([0.0, 0.0, 1.0])
SAME = 1e-6
"""of a region's size, up to which another is the same"""
SIZE = 2.0
"""edge of what the cameras look at, world units, where the file's unit means nothing"""
FAR = 100.0
"""distance from the origin, in sizes of the region, from which a capture is moved to it"""
PRECISE = 1e3
"""distance from the origin, in sizes of the region, up to which single precision is fine enough: a
fiftieth of a fine grid's voxel"""


def suggest_placement(capture: Capture) -> np.ndarray:
    """A similarity [4, 4] from the file's world to one that is upright (+Z), in place and in size.

    Files that say which way is up are turned only if it is not +Z, and keep their scale. All others
    are turned by `upright.estimate_up`, made `SIZE` units big and moved to the origin.
    """
    rotation = rotation_between(up_of(capture), UP)
    low, high = capture.region
    centre, size = (low + high) / 2, float((high - low).max())
    matrix = np.eye(4)
    scale = SIZE / size if capture.up is None and not capture.metric else 1.0
    matrix[:3, :3] = scale * rotation
    if capture.up is None or np.linalg.norm(centre) > FAR * size:
        matrix[:3, 3] = -scale * rotation @ centre
    return matrix


def placed(capture: Capture, matrix: np.ndarray) -> Capture:
    """The capture in another world: `matrix` [4, 4] is a similarity from its own to that.

    A region that its file states becomes the box around it; any other is found anew.
    """
    scale, rotation = scale_and_rotation(matrix)
    cameras = [camera.placed(matrix) for camera in capture.cameras]
    points = None
    if capture.points is not None:
        points = capture.points @ matrix[:3, :3].T + matrix[:3, 3]
    up = None if capture.up is None else rotation @ capture.up
    return replace(
        capture, cameras=tuple(cameras), points=points, up=up,
        region=_around(capture.region, matrix) if _states_region(capture)
        else region_seen_by(cameras, points), metric=capture.metric and abs(scale - 1) < 1e-9,
    )  # fmt: skip


def _states_region(capture: Capture) -> bool:
    """Whether a capture's region is another than its cameras and points tell."""
    told = region_seen_by(list(capture.cameras), capture.points)
    return bool(np.abs(capture.region - told).max() > SAME * np.ptp(capture.region, axis=0).max())


def _around(region: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """The box [2, 3] around a region in another world."""
    middle, half = region.mean(0), np.ptp(region, axis=0) / 2
    middle, half = matrix[:3, :3] @ middle + matrix[:3, 3], np.abs(matrix[:3, :3]) @ half
    return np.stack([middle - half, middle + half])


def counted_from(matrix: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """The similarity `matrix` [4, 4] for coordinates that are counted from `origin` [3]."""
    # In double precision: both may be far away.
    moved = np.array(matrix, dtype=np.float64)
    moved[:3, 3] += moved[:3, :3] @ origin
    return moved


def far_origin(capture: Capture) -> np.ndarray:
    """A point [3] near what the cameras look at, from which to count where the file's own origin is too
    far away for single precision, as with georeferenced coordinates; else zero."""
    low, high = capture.region
    centre, size = (low + high) / 2, float((high - low).max())
    if np.linalg.norm(centre) <= PRECISE * size:
        return np.zeros(3)
    return np.round(centre, max(0, math.ceil(-math.log10(size))))


def seen_from(capture: Capture, origin: np.ndarray) -> Capture:
    """The capture in the same world with its origin at `origin` [3]."""
    return replace(
        capture, cameras=tuple(camera.seen_from(origin) for camera in capture.cameras),
        points=None if capture.points is None else capture.points - origin,
        region=capture.region - origin,
    )  # fmt: skip


def rotation_between(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The smallest rotation [3, 3] that takes unit `first` [3] to unit `second` [3]."""
    cosine = float(first @ second)
    if cosine < -1 + 1e-9:
        axis = unit(np.cross(first, np.eye(3)[np.argmin(np.abs(first))]))
        return 2 * np.outer(axis, axis) - np.eye(3)
    x, y, z = np.cross(first, second)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + cross + cross @ cross / (1 + cosine)
