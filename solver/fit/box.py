"""The cube that a fit takes place in: how large it is, where it stands, and how it is turned."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import torch

from ..capture.camera import Camera
from ..capture.frames import rigid
from ..field.field import MicrofacetField
from .seen_space import cell_centres
from .simplest_axes import simplest_axes
from .visual_hull import SEEN_BY, carve, hull_box

CELLS = 96
"""of the hull that says how large the cube has to be, per axis"""
SHAPE_CELLS = 64
"""of the hull that says how the cube is to be turned, and then of that in the turned one, per axis"""
LARGER = 1.4
"""times as large as along the world's axes, up to which a cube may be turned: its voxels grow with it, and
a hull that photos from one side leave is long along their views, whatever the object is like. At 1.36 a
teapot still gained"""

STRAIGHT, TO_BE_TURNED = 0.2, (0.3, 0.9)
"""shares of the time after which the straight cube is known; and between which axes are looked for"""

Masks = Callable[[], Iterable[np.ndarray]]


@dataclass(frozen=True)
class Box:
    """A cube in world space.

    Attributes:
        centre: [3] world. half_size: half its edge, world units.
        axes: [3, 3] unit rows, its axes in the world; None: the world's.
    """

    centre: np.ndarray
    half_size: float
    axes: np.ndarray | None = None

    @classmethod
    def around(cls, region: np.ndarray) -> "Box":
        """The cube around the middle of a world box [2, 3] that is as large as its longest edge."""
        return cls(region.mean(0), float((region[1] - region[0]).max() / 2))

    @classmethod
    def of(cls, field: MicrofacetField) -> "Box":
        axes = None if field.axes is None else field.axes.cpu().numpy().astype(np.float64)
        return cls(field.centre.cpu().numpy().astype(np.float64), field.half_size, axes)

    @property
    def along_axes(self) -> np.ndarray:
        """[2, 3] min and max along its own axes, as `seen_along` has cameras."""
        centre = self.centre if self.axes is None else self.axes @ self.centre
        return np.stack([centre - self.half_size, centre + self.half_size])

    @property
    def world(self) -> np.ndarray:
        """[2, 3] min and max, along the world's axes, of the box around it."""
        half = np.full(3, self.half_size)
        half = half if self.axes is None else np.abs(self.axes.T) @ half
        return np.stack([self.centre - half, self.centre + half])

    def seen_along(self, cameras: list[Camera]) -> list[Camera]:
        """Cameras in a world that has the box's axes."""
        return cameras if self.axes is None else cameras_along(self.axes, cameras)

    def new_field(self, *args, **kwargs) -> MicrofacetField:
        """A field in it (see `MicrofacetField`, whose first two arguments are the box's)."""
        axes = None if self.axes is None else torch.tensor(self.axes)
        return MicrofacetField(torch.tensor(self.centre), self.half_size, *args, axes=axes, **kwargs)


def cameras_along(axes: np.ndarray, cameras: list[Camera]) -> list[Camera]:
    """Cameras in a world that has other axes, unit rows [3, 3]."""
    return [camera.placed(rigid(axes, np.zeros(3))) for camera in cameras]


def box_around_hull(
    cameras: list[Camera], masks: Masks, region: np.ndarray, margin: float, turn: bool,
    progress: Callable[[float], None] = lambda done: None,
) -> Box | None:  # fmt: skip
    """The cube around the visual hull in a world box [2, 3]; None if masks have nothing in common there.

    Args:
        margin: empty, around the hull, as a share of the cube.
        turn: along the axes that make the object's shape simplest, where that tells.
        progress: called with the share done; may raise to stop.
    """
    tight = hull_box(cameras, masks, region, CELLS)
    if tight is None:
        return None
    straight = _with_margin(tight, margin, None)
    progress(STRAIGHT)
    turned = _turned(cameras, masks, tight, margin, progress) if turn else None
    if turned is None or turned.half_size > LARGER * straight.half_size:
        return straight
    return turned


def _turned(
    cameras: list[Camera], masks: Masks, tight: np.ndarray, margin: float, told: Callable[[float], None]
) -> Box | None:
    """The cube around the hull within the world box [2, 3] that just holds it, along its simplest axes;
    None if those are the world's."""
    cube = Box.around(tight).world
    hull = carve(cameras, masks(), cube, SHAPE_CELLS, SEEN_BY, whole_cells=True)
    # The cube is larger than the box: what else there is of the hull has been left out.
    centres, half = cell_centres(cube, SHAPE_CELLS), (cube[1] - cube[0]) / (2 * SHAPE_CELLS)
    within = ((centres > tight[0] - half) & (centres < tight[1] + half)).all(axis=1)
    hull &= within.reshape(hull.shape)
    begin, end = TO_BE_TURNED
    axes = simplest_axes(hull, lambda done: told(begin + (end - begin) * done))
    if axes is None:
        return None
    along = centres[hull.ravel()] @ axes.T
    reach = 3**0.5 / 2 * (cube[1] - cube[0]) / SHAPE_CELLS
    found = np.stack([along.min(0) - reach, along.max(0) + reach])
    # What is as thin as a cell may be lost between those of another grid.
    turned = cameras_along(axes, cameras)
    tighter = hull_box(turned, masks, found, SHAPE_CELLS, wide=False)
    return _with_margin(found if tighter is None else tighter, margin, axes)


def _with_margin(tight: np.ndarray, margin: float, axes: np.ndarray | None) -> Box:
    """The cube around a box [2, 3] along its axes, with an empty margin, a share of the cube."""
    cube = Box.around(tight)
    centre = cube.centre if axes is None else axes.T @ cube.centre
    return Box(centre, cube.half_size * (1 + 2 * margin), axes)
