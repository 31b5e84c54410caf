"""A world for cameras that were solved without one: upright, around the origin, of a handy size."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..capture.camera import Camera
from ..capture.capture import region_seen_by

CAMERA_DISTANCE = 3.0
"""median distance of the cameras from what they look at, world units"""


@dataclass(frozen=True)
class Similarity:
    """x ↦ scale · rotation · x + translation."""

    scale: float
    rotation: np.ndarray
    translation: np.ndarray

    def points(self, points: np.ndarray) -> np.ndarray:
        """Points [N, 3], moved."""
        return self.scale * points @ self.rotation.T + self.translation

    def camera(self, camera: Camera) -> Camera:
        """A camera, moved."""
        pose = np.eye(4)
        pose[:3, :3] = self.rotation @ camera.camera_to_world[:3, :3]
        pose[:3, 3] = self.points(camera.position[None])[0]
        return replace(camera, camera_to_world=pose)


def upright(cameras: list[Camera]) -> Similarity:
    """The motion that brings up to +Z, what the cameras look at to the origin, and sizes to a scale."""
    centre = region_seen_by(cameras).mean(axis=0)
    distance = np.median([np.linalg.norm(camera.position - centre) for camera in cameras])
    scale = CAMERA_DISTANCE / max(float(distance), 1e-12)
    rotation = _to_z(_up(cameras))
    return Similarity(scale, rotation, -scale * rotation @ centre)


def _up(cameras: list[Camera]) -> np.ndarray:
    """The direction that photographers held up [3]: people hold cameras level, so the cameras' right
    hand sides lie in the horizontal plane, whatever they look down at."""
    mean = np.mean([camera.camera_to_world[:3, 1] for camera in cameras], axis=0)
    right = np.stack([camera.camera_to_world[:3, 0] for camera in cameras])
    values, vectors = np.linalg.eigh(right.T @ right / len(right))
    normal = vectors[:, 0] * np.sign(vectors[:, 0] @ mean or 1.0)
    # From one side only, the plane is not defined; with turned cameras it is another one.
    if values[1] > 0.05 and values[0] < 0.05 and normal @ mean > 0.5 * np.linalg.norm(mean):
        return normal
    length = np.linalg.norm(mean)
    return mean / length if length > 1e-6 else np.array([0.0, 0.0, 1.0])


def _to_z(up: np.ndarray) -> np.ndarray:
    """The shortest rotation [3, 3] of a unit vector to +Z."""
    cross, cosine = np.cross(up, (0.0, 0.0, 1.0)), up[2]
    if cosine < -1 + 1e-9:
        return np.diag([1.0, -1.0, -1.0])
    x, y, z = cross
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + skew + skew @ skew / (1 + cosine)
