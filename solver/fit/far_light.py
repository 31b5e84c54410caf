"""The light that photos themselves show: surroundings so far away that they light the object as seen.

A panorama made of them (`capture.panorama`) is the light in all directions that some photo looks in, up to
white, where a photo is saturated. It is the first light, and the light is held to it.
"""

from __future__ import annotations

import torch

from ..capture.panorama import Panorama
from ..capture.photos import srgb_to_linear
from ..light.environment import EnvironmentMap, equirect_coordinates, equirect_directions
from ..render.random_numbers import RandomNumbers
from ..render.scene import Scene, StepTables
from .light_start import HEIGHT, whole_light
from .losses import LEAST_LIGHT, SATURATED, light_difference, random_directions

ROWS = 256


class FarLight:
    """What is known of the light.

    Args:
        panorama: sRGB, directions of the scene's world.
    """

    def __init__(self, panorama: Panorama, device: torch.device | str = "cpu"):
        small = panorama.smaller(ROWS)
        radiance = torch.from_numpy(srgb_to_linear(small.colour)).float().clamp(min=LEAST_LIGHT)
        self.radiance = radiance.to(device)
        """[256, 512, 3] linear Rec.709, no darker than `LEAST_LIGHT`"""
        self.known = torch.from_numpy(small.known).to(device)
        """[256, 512] bool"""

    def towards(self, directions: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Radiance [N, 3] in directions [N, 3], and whether [N] it is known."""
        at = equirect_coordinates(directions, ROWS, 2 * ROWS).long()
        row, column = at[:, 1].clamp(0, ROWS - 1), at[:, 0] % (2 * ROWS)
        return self.radiance[row, column], self.known[row, column]

    def begin(self, height: int, unseen: float) -> EnvironmentMap:
        """A first light of `height` rows: what is known, and `unseen` radiance where no photo shows any."""
        times = ROWS // HEIGHT
        blocks = (HEIGHT, times, 2 * HEIGHT, times)
        count = self.known.float().view(blocks).sum((1, 3))
        total = (self.radiance.log() * self.known[..., None]).view(*blocks, 3).sum((1, 3))
        mean = total / count.clamp(min=1)[..., None]
        return whole_light(mean.view(-1, 3), (count / times**2).view(-1), height, unseen)

    @torch.no_grad()
    def put_into(self, environment: EnvironmentMap) -> None:
        """Give a light what is known in each of its texels, unless that is saturated."""
        rows = environment.height
        directions = equirect_directions(rows, 2 * rows).float().view(-1, 3)
        radiance, known = self.towards(directions.to(self.known.device))
        sure = (known & (radiance.amax(-1) < SATURATED)).view(rows, -1)
        found = radiance.log().T.view_as(environment.log_radiance)
        environment.log_radiance.copy_(torch.where(sure, found, environment.log_radiance))

    def difference(
        self, scene: Scene, tables: StepTables, random: RandomNumbers, keys: torch.Tensor
    ) -> torch.Tensor:
        """How far the light is from what is known, in random directions (see `light_difference`).

        Args:
            keys: [K] a number per direction.
        """
        directions, _ = random_directions(random, keys)
        radiance, known = self.towards(directions)
        return light_difference(scene, tables, directions, radiance, known)
