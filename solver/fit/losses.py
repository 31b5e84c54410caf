"""What the optimisation minimises."""

from __future__ import annotations

import torch

from ..render.radiance import RayBuffers
from ..render.tonemap import over_background
from .presets import FitSettings
from .ray_bank import RayBatch

WHITE = 1.0


def photometric(buffers: RayBuffers, batch: RayBatch) -> torch.Tensor:
    """Mean squared error of sRGB pixels over white.

    The prediction is not clipped, so a pixel that is too bright still has a gradient; where the
    photo itself is saturated, anything at least as bright is right.
    """
    predicted = over_background(buffers.radiance, buffers.opacity, WHITE)
    alpha = batch.alpha[:, None]
    target = batch.colour * alpha + (1 - alpha) * WHITE
    error = predicted - target
    forgiven = batch.clipped & (error > 0) & (alpha > 0.999)
    return torch.where(forgiven, torch.zeros_like(error), error).square().mean()


def total_loss(
    buffers: RayBuffers, batch: RayBatch, settings: FitSettings, use_masks: bool, fraction: float
) -> tuple[torch.Tensor, dict[str, float]]:
    """The weighted sum of all terms, and the terms that are worth showing."""
    image = photometric(buffers, batch)
    loss = image + settings.opacity_weight * buffers.opacity.mean()
    loss = loss + settings.orientation_weight * buffers.backfacing.mean()
    if use_masks:
        loss = loss + settings.mask_weight * (buffers.opacity - batch.alpha).square().mean()
    if buffers.bending is not None:
        fade = settings.smoothness_end**fraction
        loss = loss + fade * settings.bending_weight * buffers.bending.mean()
        loss = loss + fade * settings.unevenness_weight * buffers.unevenness.mean()
    return loss, {"image": float(image.detach())}
