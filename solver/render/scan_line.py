"""Where along its rays a row of pixels finds the object: a cross section of the weights."""

import numpy as np
import torch

from ..capture.camera import Camera
from ..kernels.march import composite
from .arrays import floats_on
from .scene import RenderSettings, Scene


@torch.no_grad()
def scan_line_weights(
    scene: Scene, settings: RenderSettings, camera: Camera, row: int, bins: int = 200
) -> np.ndarray:
    """Volume rendering weights [bins, W] of a row of pixels, by distance, near at the bottom.

    The bins span the field's box as the camera sees it. Every column sums to its pixel's opacity.
    """
    column = np.arange(camera.width) + 0.5
    rays = camera.rays(column, np.full(camera.width, row + 0.5))
    origins, directions = floats_on(scene.device, *rays)
    count = len(origins)
    steps = scene.sample(
        origins, directions, origins.new_zeros(count), origins.new_full((count,), 0.5), settings.step, 0.0
    )
    weights, _ = composite(steps.depth, steps.offsets)
    centre = float((scene.field.centre - origins[0]).norm())
    reach = 3**0.5 * scene.field.half_size
    position = (steps.distance - (centre - reach)) / (2 * reach)
    bin_of = (position * bins).long().clamp(0, bins - 1)
    picture = torch.zeros(bins, count, device=scene.device)
    picture.index_put_((bins - 1 - bin_of, steps.ray), weights, accumulate=True)
    return picture.cpu().numpy()
