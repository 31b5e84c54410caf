"""What an object stands on, as a part of its light that is close by: a level plane.

A map of the light holds what one point sees in each direction. What is far away every point of an object
sees in the same direction, but not the table under it, which a mirror shows best of all. So where a ray
meets the plane, the map is looked up in the direction in which its own centre sees that place: parallax
correction (Lagarde and Zanuttini 2012, doi:10.1145/2343045.2343094).

With x the ray's origin, h its height above the plane, H and c the centre's, d the ray's direction and
w = max(0, −d·up), the place is x + d h/w, and the centre sees it in the direction of d + w (x − c)/h. That
holds for rays that do not go down, too, and at the horizon nothing leaps.
"""

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ..kernels.sending import constant_on

LOWEST = 0.02
"""of the centre's height: points count as no closer to the plane"""
FARTHEST = 30.0
"""of the centre's height: what is on the plane but farther away counts as far"""


class Floor(NamedTuple):
    """The plane of points x with up·x = height, in a scene's coordinates.

    Attributes:
        up: unit. height: see above. centre: above the plane; the light's map is what is seen from here.
    """

    up: tuple[float, float, float]
    height: float
    centre: tuple[float, float, float]

    def counted_from(self, origin: np.ndarray) -> "Floor":
        """The same in coordinates that are counted from `origin` [3]."""
        centre = np.asarray(self.centre) - origin
        return Floor(self.up, self.height - float(np.dot(self.up, origin)), tuple(centre.tolist()))

    @property
    def centre_height(self) -> float:
        """Of the centre above the plane."""
        return float(np.dot(self.up, self.centre)) - self.height

    def shifts(self, points: Tensor) -> Tensor:
        """(x − c)/h [N, 3] of points x [N, 3]; no gradient."""
        points = points.detach()
        up, centre = (_like(points, values) for values in (self.up, self.centre))
        above = points @ up - self.height
        least = LOWEST * self.centre_height
        return (points - centre) / above.clamp(min=least)[:, None]

    def seen(self, shifts: Tensor, directions: Tensor) -> "SeenFromCentre":
        """What rays of unit directions [N, 3] see, as the centre sees it.

        Args:
            shifts: [N, 3] of their origins.
        """
        up = _like(directions, self.up)
        down = -(directions @ up)
        moved = directions + down.clamp(min=0)[:, None] * shifts
        length = moved.norm(dim=-1, keepdim=True)
        shifts = torch.where(down[:, None] > 0, shifts, 0.0)
        return SeenFromCentre(moved / length, length, directions, shifts, up)

    def places(self, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where [N, 3] the centre sees the plane in unit directions [N, 3], and whether [N] it does."""
        down = -(directions @ np.array(self.up))
        on_floor = down * FARTHEST > 1
        away = self.centre_height / np.where(on_floor, down, 1.0)
        return np.array(self.centre) + away[:, None] * directions, on_floor


class SeenFromCentre(NamedTuple):
    """Directions from the centre to what rays see, and how those change with these."""

    directions: Tensor  # [N, 3] unit
    length: Tensor  # [N, 1] that they had before they were made unit
    rays: Tensor  # [N, 3] unit directions of the rays themselves
    shifts: Tensor  # [N, 3] of their origins; 0 for rays that do not go down
    up: Tensor  # [3]

    @torch.no_grad()
    def along_rays(self, axes: Tensor) -> Tensor:
        """What a turn of the ray moves its place along axes [N, M, 3], as the centre sees it: Jᵀ · axis.

        Args:
            axes: unit, at right angles to `directions`.
        """
        by_shift = (axes * self.shifts[:, None]).sum(-1, keepdim=True)
        back = (axes - by_shift * self.up) / self.length[:, None]
        ray = self.rays[:, None]
        return back - (back * ray).sum(-1, keepdim=True) * ray


def _like(tensor: Tensor, values: tuple[float, ...]) -> Tensor:
    return constant_on(tensor.device, values, tensor.dtype)
