"""What rays see besides the object: the room before and behind the box, and the light at its end."""

from typing import NamedTuple

import torch
from torch import Tensor

from ..field.room import Room, contract
from ..kernels.march import composite
from .depths import all_depths
from .scene import Scene, StepTables

BEFORE, BEHIND = 24, 64
"""samples of a ray before and behind the box"""
MIN_WEIGHT = 1e-3
"""samples that weigh less have no colour; the others make up for them"""
FARTHEST = 1e-3
"""what is left of the contracted length where a ray's last sample ends"""


class Surroundings(NamedTuple):
    """The room of R rays: what they see is before + passing · (object + (1 − opacity) · behind)."""

    before: Tensor  # [R, 3] linear Rec.709, premultiplied, between origin and box
    passing: Tensor  # [R] transmittance of that
    behind: Tensor  # [R, 3] linear Rec.709, opaque: room and environment

    def around(self, radiance: Tensor, opacity: Tensor) -> Tensor:
        """Radiance [R, 3] with an object of premultiplied `radiance` and `opacity` [R] within."""
        inside = radiance + (1 - opacity)[:, None] * self.behind
        return self.before + self.passing[:, None] * inside


def surroundings(
    scene: Scene, tables: StepTables, origins: Tensor, directions: Tensor,
    pixel_angle: Tensor, u: Tensor | None = None,
) -> Surroundings:  # fmt: skip
    """The surroundings along world rays [R, 3]; without a room, the environment itself.

    Where a room lets rays through, they end in the environment, which has no gradient then.

    Args:
        pixel_angle: [R] angular width of each ray's pixel, rad.
        u: [R] offset of the samples in [0, 1); None: half.
    """
    room = scene.room
    # The light must not learn from what is seen: a room of no parallax would explain it first, and
    # what the object always hides could be any colour there and show through in its place.
    with torch.set_grad_enabled(room is None and torch.is_grad_enabled()):
        light = scene.environment.lookup(tables.light, directions, pixel_angle**2)
    if room is None:
        return Surroundings(torch.zeros_like(light), torch.ones_like(light[:, 0]), light)
    u = origins.new_full((len(origins),), 0.5) if u is None else u
    enter, leave, reach = _box_span(room, origins, directions)
    nearest = room.nearest
    # Steps of equal contracted length: at a distance r from the centre, about 1/r is what counts.
    first = 1 - reach / (reach + (enter - nearest).clamp(min=0))
    ticks = torch.linspace(1, 0, BEFORE + 1, device=origins.device)
    edges = enter[:, None] - _distance(first[:, None] * ticks, reach[:, None])
    before, passing = _seen(room, origins, directions, edges, u)
    behind, last = _seen_from(leave, reach, room, origins, directions, u)
    return Surroundings(before, passing, behind + last[:, None] * light)


def light_of_room(room: Room, directions: Tensor, u: Tensor) -> tuple[Tensor, Tensor]:
    """Premultiplied radiance [N, 3] and opacity [N] of the room, seen from the box's centre.

    Args:
        directions: [N, 3] unit. u: [N] offset of the samples in [0, 1).
    """
    origins = room.centre.expand_as(directions)
    leave = room.half_size / directions.abs().amax(-1)
    reach = torch.full_like(leave, room.half_size)
    seen, passing = _seen_from(leave, reach, room, origins, directions, u)
    return seen, 1 - passing


def _seen_from(
    leave: Tensor, reach: Tensor, room: Room, origins: Tensor, directions: Tensor, u: Tensor
) -> tuple[Tensor, Tensor]:
    """What rays see of the room once they have left the box, and what passes on."""
    ticks = torch.linspace(0, 1 - FARTHEST, BEHIND + 1, device=origins.device)
    edges = leave[:, None] + _distance(ticks.expand(len(u), -1), reach[:, None])
    return _seen(room, origins, directions, edges, u)


def _distance(share: Tensor, reach: Tensor) -> Tensor:
    """How far beyond `reach` lies the point by which a `share` of the contracted length is gone."""
    return reach / (1 - share) - reach


def _box_span(room: Room, origins: Tensor, directions: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Distances [R] at which rays enter and leave the box, and how far from its centre that is.

    A ray that misses the box has both where it comes closest, or at its start.
    """
    start = room.to_unit(origins) * room.half_size
    slope = torch.where(directions.abs() < 1e-9, torch.full_like(directions, 1e-9), directions)
    one, other = (-room.half_size - start) / slope, (room.half_size - start) / slope
    enter = torch.minimum(one, other).amax(-1)
    leave = torch.maximum(one, other).amin(-1)
    closest = -(start * directions).sum(-1)
    missed = (enter > leave) | (leave < room.nearest)
    enter, leave = torch.where(missed, closest, enter), torch.where(missed, closest, leave)
    enter, leave = enter.clamp(min=room.nearest), leave.clamp(min=room.nearest)
    away = (start + leave[:, None] * directions).abs().amax(-1)
    return enter, leave, away.clamp(min=room.half_size)


def _seen(
    room: Room, origins: Tensor, directions: Tensor, edges: Tensor, u: Tensor
) -> tuple[Tensor, Tensor]:
    """Premultiplied radiance [R, 3] and transmittance [R] of steps between `edges` [R, N + 1]."""
    rays, steps = len(origins), edges.shape[1] - 1
    distance = torch.lerp(edges[:, :-1], edges[:, 1:], u[:, None])
    unit, slope = room.to_unit(origins), directions / room.half_size

    def places(distances):
        return contract((unit[:, None] + distances[..., None] * slope[:, None]).reshape(-1, 3))

    corners = places(edges).view(rays, steps + 1, 3)
    length = (corners[:, 1:] - corners[:, :-1]).norm(dim=-1)
    points = places(distance)
    offsets = torch.arange(0, rays * steps + 1, steps, device=origins.device)
    weights, passing = composite(room.extinction(points) * length.view(-1), offsets)
    ray = torch.arange(rays, device=origins.device).repeat_interleave(steps)
    chosen = all_depths(weights, ray, 1 - passing, MIN_WEIGHT)
    return chosen.gather(room.radiance(points[chosen.index])), passing
