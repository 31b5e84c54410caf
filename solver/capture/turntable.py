"""An object that was turned before a still camera: then the light turned with the cameras.

A camera file has the object still and the cameras going round it. Of a turntable they stand on exact
circles about one axis, and the light, which stood still beside the camera, goes round with them. Cameras
that were carried around never do so exactly; those of a rig, or of a program, may, while their light stands
still. So circles alone do not tell; the photos' edges do: beside a turning object everything stays where it
was.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from .backdrop import border_of
from .camera import Camera

SAME_AXIS = 1.0
"""degrees between the axes of two turns that count as one"""
SAME_STAND, SAME_PLACE = 1.5, 0.03
"""degrees, and share of their distance, by which cameras differ that took photos from one stand, once the
turn is taken away: what programs that solve cameras leave"""
LEAST_TURN, MOST_TURN = 10.0, 170.0
"""degrees between photos that tell of the axis"""
FEWEST_OF_STAND, ONE_SIDE = 6, 0.87
"""photos of a stand; and the length of the mean of their directions, above which they show only one side"""
ON_STANDS = 0.9
"""share of the photos that share their stand with others, at least"""
_COMPARED = 120
"""photos of which every pair is looked at"""


@dataclass(frozen=True, eq=False)
class Turntable:
    """The axis about which an object was turned, in the world of its camera file.

    Attributes:
        axis: [3] unit. centre: [3] a point on it.
        zero: [3] unit, across the axis: where a camera is whose light is not turned.
    """

    axis: np.ndarray
    centre: np.ndarray
    zero: np.ndarray

    @classmethod
    def through(cls, axis: np.ndarray, centre: np.ndarray, first: np.ndarray) -> "Turntable | None":
        """That about `axis` [3] through `centre` [3] whose light is not turned for a camera at `first` [3];
        None if that is on the axis."""
        away = first - centre
        across = away - (away @ axis) * axis
        length = np.linalg.norm(across)
        return cls(axis, centre, across / length) if length > 1e-6 * np.linalg.norm(away) else None

    def angle_of(self, position: np.ndarray) -> float:
        """By how much a camera at `position` [3] goes about the axis from `zero`, rad."""
        across = np.asarray(position) - self.centre
        return float(np.arctan2(np.cross(self.zero, across) @ self.axis, self.zero @ across))

    def turn_of(self, camera: Camera) -> np.ndarray:
        """Rotation [3, 3] of the light for a camera's photo: light that comes from direction d when the
        camera is at `zero` comes from turn · d."""
        return self.rotation(self.angle_of(camera.position))

    def rotation(self, angle: float) -> np.ndarray:
        """Rotation [3, 3] about the axis by an angle, rad."""
        return Rotation.from_rotvec(angle * self.axis).as_matrix()

    def seen_from(self, origin: np.ndarray) -> "Turntable":
        """The same in a world whose origin is at `origin` [3]."""
        return Turntable(self.axis, self.centre - origin, self.zero)


@dataclass(frozen=True, eq=False)
class Stands:
    """Where cameras stood while an object turned.

    Attributes:
        turntable: `zero` is the first camera's side.
        of_photo: [N] int, the stand of every photo; −1: of no other's.
    """

    turntable: Turntable
    of_photo: np.ndarray

    @property
    def share(self) -> float:
        """Share of the photos that have a stand."""
        return float((self.of_photo >= 0).mean())


def stands_of(cameras: Sequence[Camera]) -> Stands | None:
    """The axis that cameras go round, and which of them share a stand; None: they go round none.

    The first camera's side is where the light is not turned.
    """
    poses = np.stack([camera.camera_to_world for camera in cameras])
    found = _axis_of(poses[:: -(-len(poses) // _COMPARED)])
    if found is None:
        return None
    turntable = Turntable.through(*found, poses[0, :3, 3])
    return turntable and Stands(turntable, _shared_stands(turntable, cameras))


def _axis_of(poses: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Direction [3] and a point [3] of the axis about which most pairs of poses [N, 4, 4] turn."""
    one, other = np.triu_indices(len(poses), 1)
    rotation = Rotation.from_matrix(poses[one, :3, :3] @ poses[other, :3, :3].swapaxes(1, 2))
    vectors = rotation.as_rotvec()
    angles = np.linalg.norm(vectors, axis=1)
    telling = (angles > np.radians(LEAST_TURN)) & (angles < np.radians(MOST_TURN))
    if telling.sum() < FEWEST_OF_STAND:
        return None
    one, other, axes = one[telling], other[telling], (vectors / angles[:, None].clip(1e-9))[telling]
    candidates = axes[:: -(-len(axes) // 400)]
    near = np.abs(axes @ candidates.T) > np.cos(np.radians(SAME_AXIS))
    chosen = near[:, near.sum(0).argmax()]
    axis = np.linalg.svd(axes[chosen], full_matrices=False)[2][0]
    # (1 − R) · centre = p − R · p′ for every pair; along the axis any centre will do.
    turns = rotation[telling][chosen].as_matrix()
    moved = poses[one[chosen], :3, 3] - np.einsum("nij,nj->ni", turns, poses[other[chosen], :3, 3])
    centre = np.linalg.lstsq(
        np.concatenate([(np.eye(3) - turns).reshape(-1, 3), axis[None]]),
        np.append(moved.ravel(), poses[:, :3, 3].mean(0) @ axis),
        rcond=None,
    )[0]
    # Up as the photos have it, so that a turn has the same sign for all who look at it.
    return (axis if (poses[:, :3, 1] @ axis).sum() >= 0 else -axis), centre


def _shared_stands(turntable: Turntable, cameras: Sequence[Camera]) -> np.ndarray:
    """[N] int: which cameras are in one place, once the turn is taken away; −1: alone, or nearly."""
    angles = np.array([turntable.angle_of(camera.position) for camera in cameras])
    back = np.stack([turntable.rotation(-angle) for angle in angles])
    poses = np.stack([camera.camera_to_world for camera in cameras])
    looks = back @ poses[:, :3, :3]
    places = np.einsum("nij,nj->ni", back, poses[:, :3, 3] - turntable.centre)
    stands, free = np.full(len(cameras), -1), np.ones(len(cameras), bool)
    for index in range(len(cameras)):
        if not free[index]:
            continue
        apart = Rotation.from_matrix(looks @ looks[index].T).magnitude()
        distance = np.linalg.norm(places - places[index], axis=1)
        near = free & (apart < np.radians(SAME_STAND))
        near &= distance < SAME_PLACE * np.linalg.norm(places[index])
        one_side = abs(np.exp(1j * angles[near]).mean()) > ONE_SIDE
        if near.sum() >= FEWEST_OF_STAND and not one_side:
            stands[near], free = index, free & ~near
    return stands


STEADY = 0.25
"""share of the photos' own contrast, squared, by which their edges may differ while they stand still"""
LEAST_CONTRAST = 1.5
"""levels of 255 between left and right, below which edges tell nothing"""


def stands_still(photos: Sequence[np.ndarray], stands: np.ndarray) -> bool | None:
    """True if the edges of photos from one stand show the same, whatever way the object is turned; None if
    they show nothing that could tell.

    Only the difference between left and right counts: a floor below a sky, and lenses that darken
    corners, look alike from all sides.

    Args:
        photos: [H, W, 3] uint8 sRGB each, of one size where they share a stand. stands: `Stands.of_photo`.
    """
    same = differ = count = 0.0
    for stand in np.unique(stands[stands >= 0]):
        of_stand = [photos[index] for index in np.flatnonzero(stands == stand)]
        if len({photo.shape for photo in of_stand}) > 1:
            continue
        sides = np.stack([border_of(photo.astype(float) - photo[:, ::-1]) for photo in of_stand])
        same += len(sides) * float((sides.mean(0) ** 2).mean())
        differ += len(sides) * float(sides.var(0).mean())
        count += len(sides)
    if count == 0 or same + differ < count * LEAST_CONTRAST**2:
        return None
    return differ < STEADY * same
