"""Rays through pixels, and what a pixel sees: the mean of what its rays see.

A ray through a pixel's centre cannot match a photo that averages over all of it; a few, each with its
share of the pixel's width, come near (docs/decisions/0011).
"""

import dataclasses
import math

import numpy as np
import torch
from torch import Tensor

from ..kernels.sending import constant_on
from .radiance import RayBuffers


def places_in_pixel(grid: int) -> np.ndarray:
    """Where rays go through a pixel [grid², 2]: (column, row) from its centre, in pixels; the centres of
    grid × grid squares."""
    ticks = (np.arange(grid) + 0.5) / grid - 0.5
    return np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)


def secondary_rays_each(secondary_rays: int, grid: int) -> int:
    """Secondary rays of one of a pixel's grid² rays, which share them; never none."""
    return max(1, secondary_rays // grid**2)


def keys_of_rays(keys: Tensor, rays: int) -> Tensor:
    """Keys [P·rays] of the rays of pixels, one pixel's after the other's, from those of pixels [P]."""
    return (keys[:, None] * rays + torch.arange(rays, device=keys.device)).flatten()


def mean_of_rays(values: Tensor, rays: int) -> Tensor:
    """Means [P, …] over every `rays` values of [P·rays, …]."""
    return values if rays == 1 else values.unflatten(0, (-1, rays)).mean(1)


def halves_of_rays(values: Tensor, rays: int) -> Tensor:
    """Means [P, 2, C] over the black and the white squares of a chess board, of values [P·rays, C].

    Depths and secondary rays of each are drawn by numbers of its own. Over both, what slopes evenly has the
    same mean, so that what is between them is noise, but for what bends within a pixel.
    """
    row, column = np.divmod(np.arange(rays), math.isqrt(rays))
    white = (row + column) % 2
    shares = np.stack([(1 - white) / (1 - white).sum(), white / white.sum()])
    shares = constant_on(values.device, tuple(map(tuple, shares.tolist())))
    return shares @ values.unflatten(0, (-1, rays))


def pixels_of(buffers: RayBuffers, rays: int, halves: bool = False) -> RayBuffers:
    """What pixels saw, from what their rays did, `rays` each; what halves of several did only if wanted."""
    if rays == 1:
        return buffers
    seen = {
        field.name: mean_of_rays(value, rays)
        for field in dataclasses.fields(buffers)
        if isinstance(value := getattr(buffers, field.name), Tensor)
    }
    if halves:
        radiance_and_opacity = torch.cat([buffers.radiance, buffers.opacity[:, None]], 1)
        seen["halves"] = halves_of_rays(radiance_and_opacity, rays)
    return dataclasses.replace(buffers, **seen)
