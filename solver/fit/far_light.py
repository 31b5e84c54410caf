"""The light that photos themselves show: surroundings so far away that they light the object as seen.

A panorama made of them (`capture.panorama`) is the light in all directions that some photo looks in, up to
white, where a photo is saturated. It is the first light, and the light is held to it.
"""

from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor

from ..capture.panorama import Panorama
from ..capture.photos import srgb_to_linear
from ..light.environment import EnvironmentMap, equirect_coordinates
from ..light.floor import Floor
from ..render.random_numbers import RandomNumbers
from ..render.scene import Scene, StepTables
from .light_start import HEIGHT, whole_light
from .losses import LEAST_LIGHT, SATURATED, light_difference, random_directions

ROWS = 256


class SeenLight(NamedTuple):
    """What photos show of the light of their object, as far as they do."""

    held: Panorama | None = None  # to which the light is held: what is far, or the floor
    first: Panorama | None = None  # what it begins as, where that is not what it is held to
    floor: Floor | None = None  # what of it is close by, world


NOTHING_SEEN = SeenLight()


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

    def towards(self, directions: Tensor) -> tuple[Tensor, Tensor]:
        """Radiance [N, 3] in directions [N, 3], and whether [N] it is known."""
        at = equirect_coordinates(directions, ROWS, 2 * ROWS).long()
        row, column = at[:, 1].clamp(0, ROWS - 1), at[:, 0] % (2 * ROWS)
        return self.radiance[row, column], self.known[row, column]

    def begin(self, height: int, unseen: float) -> EnvironmentMap:
        """A first light of `height` rows: what is known, and `unseen` radiance where no photo shows any."""
        radiance, known, _ = self._on_map(HEIGHT)
        return whole_light(radiance.log().flatten(1).T, known.flatten(), height, unseen)

    @torch.no_grad()
    def put_into(self, environment: EnvironmentMap) -> None:
        """Give a light what is known in each of its texels, unless that is saturated."""
        radiance, known, brightest = self._on_map(environment.height)
        sure = (known >= 0.5) & (brightest < SATURATED)
        found = torch.where(sure, radiance.log(), environment.log_radiance)
        environment.log_radiance.copy_(found)

    def _on_map(self, height: int) -> tuple[Tensor, Tensor, Tensor]:
        """Of each texel of a map the mean [3, H, 2H] of what is known, how much [H, 2H] that is, and the
        brightest channel [H, 2H]."""
        size, known = (height, 2 * height), self.known.float()[None]
        radiance = self.radiance.permute(2, 0, 1)
        share = F.adaptive_avg_pool2d(known, size)
        mean = F.adaptive_avg_pool2d(radiance * known, size) / share.clamp(min=1e-6)
        brightest = F.adaptive_max_pool2d(radiance.amax(0, keepdim=True) * known, size)
        return mean.clamp(min=LEAST_LIGHT), share[0], brightest[0]

    def difference(self, scene: Scene, tables: StepTables, random: RandomNumbers, keys: Tensor) -> Tensor:
        """How far the light is from what is known, in random directions (see `light_difference`).

        Args:
            keys: [K] a number per direction.
        """
        directions, _ = random_directions(random, keys)
        radiance, known = self.towards(directions)
        return light_difference(scene, tables, directions, radiance, known)
