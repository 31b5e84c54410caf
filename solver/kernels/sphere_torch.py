"""Bilinear lookups of a map on the sphere: the plain torch twin of `sphere_numba`."""

import torch
import torch.nn.functional as F


def look_up(values: torch.Tensor, places: torch.Tensor) -> torch.Tensor:
    """See `sphere.look_up`; of any number of channels and any type."""
    over = values.roll(values.shape[2] // 2, -1)
    values = torch.cat([over[:, :1], values, over[:, -1:]], 1)
    values = torch.cat([values[..., -1:], values, values[..., :1]], -1)
    # Places in [−1, 1] over the edges of the map that has been continued.
    size = places.new_tensor([values.shape[2], values.shape[1]])
    places = 2 * (places + 1) / size - 1
    return F.grid_sample(values[None], places[None], align_corners=False)[0]
