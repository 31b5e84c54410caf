"""Where something can be, from the cameras alone: what they look at, and where they were carried."""

import numpy as np
import scipy.spatial

from ..capture.camera import Camera, positions_of

SHARE, FEWEST = 0.1, 3
"""of the cameras, and how many at least, that must look at what can be told from photos"""
CORE = 0.7
"""times as many cameras as look at any place that look at the core of a capture, where the object is"""


def cell_centres(region: np.ndarray, cells: int) -> np.ndarray:
    """Centres [K·K·K, 3] of the cells of a grid over the box `region` [2, 3], x slowest."""
    ticks = region[0] + (np.arange(cells)[:, None] + 0.5) / cells * (region[1] - region[0])
    return np.stack(np.meshgrid(*ticks.T, indexing="ij"), axis=-1).reshape(-1, 3)


def seen_cells(cameras: list[Camera], region: np.ndarray, cells: int) -> np.ndarray:
    """Boolean grid [K, K, K] of cell centres of `region` [2, 3] that can be told from photos."""
    nearest, fewest = nearest_distance(cameras, region.mean(0)), max(FEWEST, SHARE * len(cameras))
    seen = seen_points(cameras, cell_centres(region, cells), nearest, fewest)
    return seen.reshape(cells, cells, cells)


def looked_at_most(cameras: list[Camera], region: np.ndarray, cells: int) -> np.ndarray:
    """Those of `seen_cells` [K, K, K] that nearly as many cameras have in their frame as have any."""
    points = cell_centres(region, cells)
    count, nearest = _times_in_frame(cameras, points), nearest_distance(cameras, region.mean(0))
    most = count >= max(FEWEST, SHARE * len(cameras), CORE * count.max())
    return (most & _clear_of(cameras, points, nearest)).reshape(cells, cells, cells)


def nearest_distance(cameras: list[Camera], centre: np.ndarray) -> float:
    """Distance from a camera within which nothing is, world units: a share of the median distance
    from `centre` [3]. What hangs before a lens explains any photo."""
    positions = positions_of(cameras)
    return float(0.15 * np.median(np.linalg.norm(positions - centre, axis=1)))


def seen_points(cameras: list[Camera], points: np.ndarray, nearest: float, fewest: float) -> np.ndarray:
    """Boolean [N] of world points [N, 3] that cameras look at and none has right before it.

    Args:
        nearest: distance of what is right before a camera, world units. fewest: cameras that must look.
    """
    return (_times_in_frame(cameras, points) >= fewest) & _clear_of(cameras, points, nearest)


def _clear_of(cameras: list[Camera], points: np.ndarray, nearest: float) -> np.ndarray:
    """Boolean [N] of world points [N, 3] that are further than `nearest` from all cameras."""
    clear = np.ones(len(points), dtype=bool)
    for camera in cameras:
        clear &= np.linalg.norm(points - camera.position, axis=1) > nearest
    return clear


def _times_in_frame(cameras: list[Camera], points: np.ndarray) -> np.ndarray:
    """How many cameras [N] have world points [N, 3] in their frame."""
    return sum((camera.in_frame(points) for camera in cameras), np.zeros(len(points), dtype=int))


def walked_through(cameras: list[Camera], points: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Boolean [N] of world points [N, 3] in the convex hull of the cameras and what they look at, [3].

    Somebody walked there with a camera and saw the object from everywhere, so it is most likely empty.
    """
    corners = np.stack([*(camera.position for camera in cameras), centre])
    try:
        # Joggled, since cameras on a ring lie in a plane.
        hull = scipy.spatial.Delaunay(corners, qhull_options="QJ Qbb Qc")
    except (scipy.spatial.QhullError, ValueError):
        return np.zeros(len(points), dtype=bool)
    return hull.find_simplex(points) >= 0
