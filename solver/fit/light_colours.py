"""Colours of a fitted light, as coarse as its photos allow.

Photos of something red tell little of the light's red. What they leave open each channel fills with noise
of its own: red and cyan specks, the first thing to be seen of a light that stands behind its object.
"""

from collections.abc import Callable

import torch
from torch import Tensor

from ..light.environment import coarsely_coloured
from ..light.smoothing import LEAST_RADIANCE
from ..render.scene import Scene, SharedTables
from .chunk import ChunkLoss
from .step import Step

SQUARES = (16, 8, 4, 2)
"""edges, in texels, of the squares that may have one colour, the coarsest first"""


def coarsest_colours(radiance: Tensor, error: Callable[[Tensor], float], tolerance: float) -> Tensor:
    """The light [3, H, 2H] with the coarsest colours under which photos are as good as under its own.

    Args:
        error: of photos under a light. tolerance: share by which it may grow.
    """
    most = (1 + tolerance) * error(radiance)
    for texels in SQUARES:
        if radiance.shape[1] % texels == 0:
            coarse = coarsely_coloured(radiance, texels)
            if error(coarse) <= most:
                return coarse
    return radiance


@torch.no_grad()
def colour_coarsely(scene: Scene, loss: ChunkLoss, steps: list[Step], tolerance: float) -> None:
    """Give a scene's light the coarsest colours that pixels of steps allow (see `coarsest_colours`)."""

    def take(radiance: Tensor) -> None:
        scene.environment.log_radiance.copy_(radiance.clamp(min=LEAST_RADIANCE).log())

    def error(radiance: Tensor) -> float:
        take(radiance)
        found = 0.0
        for chunks, turns in steps:
            tables = SharedTables.of(scene, turns)
            errors = [loss.image_error(scene, tables.under(c.turn), c) for c in chunks]
            found += sum(errors) / len(steps)
        return found

    take(coarsest_colours(scene.environment.radiance(), error, tolerance))
