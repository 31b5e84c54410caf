"""The light under which points begin to reflect, before a room: what has been found of the room by then.

While points shine by themselves, nothing lights them, and the light itself has no gradient but a slow pull
to the room. Once they reflect, all at once depends on it: under a light that is still grey, a white vase
between red walls turns pink, and metal has nothing to mirror.
"""

import torch
from torch import Tensor

from ..field.room import Room
from ..light.environment import EnvironmentMap, equirect_directions, resized_map, texel_solid_angles
from .losses import known_of_room

HEIGHT, COARSE = 128, 16
"""rows of the map on which the room is looked at, and of that which fills its gaps"""
TOLD = 0.3
"""opacity from which a room's colour is known: what is seen through it is the start's grey"""
REACH = 30.0
"""sharpness κ of the lobe exp(κ (cos − 1)), about 10° wide, whose colours fill its middle's gaps"""
GAP = 0.2
"""share of that lobe that has to be known"""
WHITE = 0.9
"""mean radiance of the light, by which a white surface is white: photos are exposed so"""
DIMMEST, BRIGHTEST = 0.5, 4.0
"""radiance of what no photo shows: the sky, or lamps"""
DIRECTIONS_AT_ONCE = 8192


@torch.no_grad()
def light_from_room(room: Room, height: int) -> EnvironmentMap:
    """The light that a room sends to the centre of its box, linear Rec.709, as a map of `height` rows."""
    device = room.centre.device
    directions = equirect_directions(HEIGHT, 2 * HEIGHT).float().view(-1, 3).to(device)
    pieces = [
        known_of_room(room, some, torch.full_like(some[:, 0], 0.5))
        for some in directions.split(DIRECTIONS_AT_ONCE)
    ]
    seen, opacity = (torch.cat(values) for values in zip(*pieces, strict=True))
    return whole_light(seen.log(), (opacity / TOLD).clamp(max=1.0), height)


@torch.no_grad()
def whole_light(colour: Tensor, known: Tensor, height: int, unseen: float | None = None) -> EnvironmentMap:
    """A light of `height` rows of which a part is known; small gaps have the colours around them.

    Args:
        colour: [N, 3] log-radiance, linear Rec.709, of the texels of a map of `HEIGHT` rows.
        known: [N] how far it is known, 0 to 1.
        unseen: radiance of what no photo shows, mostly what is above. None: as bright as makes the whole
            light's mean that of a well exposed photo's white (docs/decisions/0025).
    """
    device = colour.device
    directions = equirect_directions(HEIGHT, 2 * HEIGHT).float().view(-1, 3).to(device)
    texel = texel_solid_angles(HEIGHT).float().repeat_interleave(2 * HEIGHT).to(device)
    around, filled = _filled_from_around(directions, colour, known, texel)
    told = known + (1 - known) * filled
    found = torch.lerp(around, colour, known[:, None])
    radiance = told[:, None] * found.exp()
    share = texel / texel.sum()
    grey = unseen
    if grey is None:
        missing = WHITE - (share * radiance.mean(1)).sum()
        grey = (missing / (share * (1 - told)).sum().clamp(min=1e-6)).clamp(DIMMEST, BRIGHTEST)
    radiance = (radiance + (1 - told)[:, None] * grey).view(HEIGHT, 2 * HEIGHT, 3)
    return EnvironmentMap.from_radiance(radiance).to(device).resized(height)


def _filled_from_around(
    directions: Tensor, colour: Tensor, known: Tensor, texel: Tensor
) -> tuple[Tensor, Tensor]:
    """Log-radiance [N, 3] around each direction, and how far [N] that tells its own, 0 to 1.

    Args:
        directions: [N, 3] unit. colour: [N, 3] log-radiance. known: [N] how far, 0 to 1. texel: [N] sr.
    """
    coarse = equirect_directions(COARSE, 2 * COARSE).float().view(-1, 3).to(directions)
    lobe = torch.exp(REACH * (coarse @ directions.T - 1)) * texel
    weight = lobe @ known
    mean = (lobe * known) @ colour / weight.clamp(min=1e-9)[:, None]
    confidence = (weight / lobe.sum(1) / GAP).clamp(max=1.0)
    large, sure = (
        resized_map(values.T.reshape(3, COARSE, 2 * COARSE), HEIGHT).flatten(1).T
        for values in (mean, confidence[:, None].expand(-1, 3))
    )
    return large, sure[:, 0]
