"""What the optimisation minimises."""

from __future__ import annotations

from typing import NamedTuple

import torch

from ..render.radiance import RayBuffers
from ..render.tonemap import linear_to_srgb, over_background
from .presets import FitSettings
from .ray_bank import RayBatch


class Behind(NamedTuple):
    """What is seen where the object is not.

    Photos with alpha are laid over an sRGB colour; a photo's own background is light in the scene.
    """

    colour: torch.Tensor  # [R, 3] sRGB, or linear radiance
    is_linear: bool = False


def photometric(
    buffers: RayBuffers, batch: RayBatch, behind: Behind, gain: torch.Tensor | None = None
) -> torch.Tensor:
    """Mean squared error of sRGB pixels.

    The prediction is not clipped, so a pixel that is too bright still has a gradient; where the
    photo itself is saturated, anything at least as bright is right.

    Args:
        gain: [R, 1 or 3] of the photos' exposure, or None for 1.
    """
    gain = 1.0 if gain is None else gain
    alpha = batch.alpha[:, None]
    if behind.is_linear:
        passing = (1 - buffers.opacity)[:, None]
        predicted = linear_to_srgb(gain * (buffers.radiance + passing * behind.colour))
        target = batch.colour * alpha + (1 - alpha) * linear_to_srgb(gain * behind.colour.detach())
    else:
        predicted = over_background(gain * buffers.radiance, buffers.opacity, behind.colour)
        target = batch.colour * alpha + (1 - alpha) * behind.colour
    error = predicted - target
    forgiven = batch.clipped & (error > 0) & (alpha > 0.999)
    return torch.where(forgiven, torch.zeros_like(error), error).square().mean()


def total_loss(
    buffers: RayBuffers, batch: RayBatch, settings: FitSettings, use_masks: bool, fraction: float,
    behind: Behind, gain: torch.Tensor | None = None,
) -> tuple[torch.Tensor, dict[str, float]]:  # fmt: skip
    """The weighted sum of all terms, and the terms that are worth showing.

    Args:
        use_masks: opacity is held to the photos' alpha.
        fraction: how much of the fit is done; smoothness terms fade with it.
        gain: see `photometric`.
    """
    image = photometric(buffers, batch, behind, gain)
    loss = image + settings.opacity_weight * buffers.opacity.mean()
    loss = loss + settings.orientation_weight * buffers.backfacing.mean()
    if use_masks and settings.mask_weight > 0:
        loss = loss + settings.mask_weight * (buffers.opacity - batch.alpha).square().mean()
    if settings.roughness_weight > 0:
        loss = loss + (1 - fraction) * settings.roughness_weight * buffers.alpha.mean()
    if buffers.bending is not None:
        fade = settings.smoothness_end**fraction
        loss = loss + fade * settings.bending_weight * buffers.bending.mean()
        loss = loss + fade * settings.unevenness_weight * buffers.unevenness.mean()
    return loss, {"image": float(image.detach())}
