"""What an object stands on: a level plane among a capture's sparse points."""

from typing import NamedTuple

import numpy as np

TRIES = 600
"""planes through three points each that are tried"""
MARGIN = 0.25
"""of the region's edges, within which around it points count, too: it may end where the object does"""
THICK = 0.01
"""of the region's longest edge: how far from a plane its points may be"""
LEVEL = np.cos(np.radians(20))
"""of the angle between a plane's normal and the cameras' up"""
FEWEST, SHARE = 60, 0.2
"""points of a support, and their share of those in the region, at least"""
BELOW = 0.5
"""share of the region's height within which, from its bottom, a support is sought: what is higher stands on
something itself"""


class Support(NamedTuple):
    """The plane of points x with normal·x = height, and which side is up."""

    normal: np.ndarray  # [3] unit, world
    height: float

    def above(self, points: np.ndarray) -> np.ndarray:
        """Heights [N] of world points [N, 3] above it."""
        return points @ self.normal - self.height

    def axes(self) -> tuple[np.ndarray, np.ndarray]:
        """Two unit vectors [3] along it, at right angles."""
        first = np.cross(self.normal, np.eye(3)[np.argmin(np.abs(self.normal))])
        first /= np.linalg.norm(first)
        return first, np.cross(self.normal, first)


def support_of(points: np.ndarray, region: np.ndarray, up: np.ndarray) -> Support | None:
    """The level plane with most points of a region; None if there is no such plane.

    RANSAC (Fischler and Bolles 1981, doi:10.1145/358669.358692), then least squares.

    Args:
        points: [N, 3] sparse points, world.
        region: [2, 3] world box of the object.
        up: [3] unit world direction.
    """
    margin = MARGIN * (region[1] - region[0])
    inside = points[((points >= region[0] - margin) & (points <= region[1] + margin)).all(1)]
    if len(inside) < FEWEST:
        return None
    thick = THICK * float((region[1] - region[0]).max())
    random = np.random.default_rng(0)
    corners = inside[random.integers(0, len(inside), (TRIES, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    corners, normals = corners[lengths > 0], normals[lengths > 0] / lengths[lengths > 0, None]
    normals *= np.where(normals @ up < 0, -1.0, 1.0)[:, None]
    level = normals @ up > LEVEL
    if not level.any():
        return None
    tried = [
        Support(normal, float(normal @ corner[0]))
        for normal, corner in zip(normals[level], corners[level], strict=True)
    ]
    best = max(tried, key=lambda plane: int((np.abs(plane.above(inside)) < thick).sum()))
    for _ in range(3):
        on = inside[np.abs(best.above(inside)) < thick]
        normal = np.linalg.svd(on - on.mean(0))[2][2] if len(on) > 3 else best.normal
        normal = normal if normal @ up > 0 else -normal
        best = Support(normal, float(normal @ on.mean(0)))
    on = int((np.abs(best.above(inside)) < thick).sum())
    corners = np.stack(np.meshgrid(*region.T, indexing="ij"), -1).reshape(-1, 3)
    lowest, highest = best.above(corners).min(), best.above(corners).max()
    is_low = -lowest < BELOW * (highest - lowest)
    enough = on >= max(FEWEST, SHARE * len(inside)) and best.normal @ up > LEVEL
    return best if enough and is_low else None
