"""The neutral capture every reader returns, and the world box its cameras look at."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .camera import Camera, positions_of
from .frames import unit
from .image_header import may_have_alpha


@dataclass(frozen=True, eq=False)
class Capture:
    """Cameras with photos.

    Attributes:
        source: the file that was read.
        region: [2, 3] world box (min, max) that holds what the cameras look at; generous.
        warnings: sentences about what was left out.
        format: the reader's name.
        points: [N, 3] sparse points of the surroundings, world; None if the file has none.
        up: [3] the world's direction that points up, if the format says so.
        metric: world units are metres.
    """

    source: Path
    cameras: tuple[Camera, ...]
    region: np.ndarray
    warnings: tuple[str, ...] = ()
    format: str = "transforms"
    points: np.ndarray | None = None
    up: np.ndarray | None = None
    metric: bool = False

    @property
    def has_few_points(self) -> bool:
        """Too few sparse points to say where anything is."""
        return self.points is None or len(self.points) < FEWEST_POINTS


FEWEST_POINTS = 100
"""sparse points from which they say more about the object's bounds than the cameras do"""


MARGIN, CLOSEST = 0.3, 0.7
"""of half the views: how far a box reaches beyond its sparse points, and at least from its centre"""
WIDE_VIEWS = 0.8
"""share of the views that may be narrower than a box: masks find the object in it, whatever its size"""
LONGEST_WITHOUT_MASKS = 1.2
"""longer side of what belongs to the object, in shorter sides of the views, where there are no masks"""


def region_seen_by(cameras: list[Camera], points: np.ndarray | None = None) -> np.ndarray:
    """World box [2, 3] of what the cameras look at.

    A cube around the point where the optical axes meet, as big as the views: the centre minimises
    the squared distance to all axes, the half edge is what the median camera sees to either side; with
    masks, what a fifth see at least, up to where they look past the centre, for most may be close-ups.
    Panoramas have no axis: alone, they are taken to go around what they show, so the cube is around their
    middle and reaches nearly to them; beside other cameras, those tell.
    Sparse points within it, where there are many, draw its faces closer. Masks will do so better, so
    with them points do not, and the longer side of the views counts; without, what lies along it is
    likely the room.

    Args:
        points: [N, 3] sparse points, world.
    """
    masked = _may_have_masks(cameras)
    cube = cube_seen_by(cameras, masked)
    if points is None or masked:
        return cube
    inside = points[((points >= cube[0]) & (points <= cube[1])).all(axis=1)]
    if len(inside) < FEWEST_POINTS:
        return cube
    low, high = np.percentile(inside, (0.5, 99.5), axis=0)
    # Shiny and plain things have no points, only what they stand on, so the box stays generous.
    centre, half = cube.mean(0), (cube[1] - cube[0]) / 2
    low = np.minimum(low - MARGIN * half, centre - CLOSEST * half)
    high = np.maximum(high + MARGIN * half, centre + CLOSEST * half)
    return np.stack([np.maximum(low, cube[0]), np.minimum(high, cube[1])])


def evenly_taken(count: int, most: int) -> np.ndarray:
    """Indices of at most so many of `count` cameras, evenly taken from all."""
    return np.linspace(0, count - 1, min(most, count)).astype(int)


def cube_seen_by(cameras: list[Camera], masked: bool = False) -> np.ndarray:
    """World cube [2, 3] as big as the views of cameras, around what they look at (see `region_seen_by`).

    Args:
        masked: photos have masks, or may have.
    """
    cameras = [camera for camera in cameras if not camera.is_panoramic] or cameras
    positions = positions_of(cameras)
    axes = np.stack([camera.view_direction for camera in cameras])
    if cameras[0].is_panoramic:
        middle = 0.5 * (positions.min(0) + positions.max(0))
        axes = unit(middle - positions, 1e-12)
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    system = across.sum(0) + 1e-6 * len(cameras) * np.eye(3)
    anchor = positions.mean(0)
    target = np.einsum("nij,nj->i", across, positions) + 1e-6 * len(cameras) * anchor
    centre = np.linalg.solve(system, target)
    distance = np.maximum(np.einsum("nj,nj->n", centre - positions, axes), 0)
    if np.median(distance) <= 1e-9:
        # The axes diverge, or there is one camera: look a unit ahead.
        distance = np.ones(len(cameras))
        centre = (positions + axes).mean(0)
    shorter, longer = np.sort([(c.width / c.fx, c.height / c.fy) for c in cameras]).T / 2
    if masked:
        past = np.linalg.norm(positions + distance[:, None] * axes - centre, axis=1)
        half = np.quantile(past + distance * longer, WIDE_VIEWS)
    else:
        half = np.median(distance * np.minimum(longer, LONGEST_WITHOUT_MASKS * shorter))
    half = min(half, 0.9 * np.median(distance))
    return np.stack([centre - half, centre + half])


def _may_have_masks(cameras: list[Camera]) -> bool:
    """Masks beside the photos, or within the first."""
    first = cameras[0].image_path
    return any(c.mask_path for c in cameras) or first is None or may_have_alpha(first)
