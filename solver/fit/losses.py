"""What the optimisation minimises."""

from __future__ import annotations

import torch

from ..render.radiance import RayBuffers
from ..render.tonemap import linear_to_srgb, over_background
from .presets import FitSettings
from .ray_bank import RayBatch

WHITE = 1.0


def photometric(
    buffers: RayBuffers, batch: RayBatch, behind: torch.Tensor | None = None
) -> torch.Tensor:
    """Mean squared error of sRGB pixels over white, or over linear radiance `behind` [R, 3].

    The prediction is not clipped, so a pixel that is too bright still has a gradient; where the
    photo itself is saturated, anything at least as bright is right.
    """
    if behind is None:
        predicted = over_background(buffers.radiance, buffers.opacity, WHITE)
    else:
        passing = (1 - buffers.opacity)[:, None]
        predicted = linear_to_srgb(buffers.radiance + passing * behind)
    alpha = batch.alpha[:, None]
    target = batch.colour * alpha + (1 - alpha) * WHITE
    error = predicted - target
    forgiven = batch.clipped & (error > 0) & (alpha > 0.999)
    return torch.where(forgiven, torch.zeros_like(error), error).square().mean()


def total_loss(
    buffers: RayBuffers,
    batch: RayBatch,
    settings: FitSettings,
    use_masks: bool,
    fraction: float,
    behind: torch.Tensor | None = None,
) -> tuple[torch.Tensor, dict[str, float]]:
    """The weighted sum of all terms, and the terms that are worth showing.

    Args:
        use_masks: opacity is held to the photos' alpha.
        fraction: how much of the fit is done; smoothness terms fade with it.
        behind: [R, 3] radiance behind the object, or None for white.
    """
    image = photometric(buffers, batch, behind)
    loss = image + settings.opacity_weight * buffers.opacity.mean()
    loss = loss + settings.orientation_weight * buffers.backfacing.mean()
    if use_masks:
        loss = loss + settings.mask_weight * (buffers.opacity - batch.alpha).square().mean()
    if buffers.bending is not None:
        fade = settings.smoothness_end**fraction
        loss = loss + fade * settings.bending_weight * buffers.bending.mean()
        loss = loss + fade * settings.unevenness_weight * buffers.unevenness.mean()
    return loss, {"image": float(image.detach())}
