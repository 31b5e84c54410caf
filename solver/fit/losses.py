"""What the optimisation minimises."""

import math

import torch
from torch import Tensor

from ..field.room import Room
from ..kernels.pointwise import at_hand, rowwise
from ..render.radiance import RayBuffers
from ..render.random_numbers import ROOM_DIRECTION, RandomNumbers
from ..render.scene import Scene, StepTables
from ..render.surroundings import Surroundings, light_of_room
from ..render.tonemap import linear_to_srgb, over_background
from .ray_bank import RayBatch
from .settings import FitSettings

SATURATED = 0.95
"""radiance from which a photo's white may be any brighter light"""
LEAST_LIGHT = 1e-2
"""radiance below which light and room are equally dark"""

Behind = Tensor | Surroundings
"""what is seen where the object is not: an sRGB colour [R, 3] over which photos with alpha are laid, or
what else there is in the scene, where a photo shows that"""


def photometric(buffers: RayBuffers, batch: RayBatch, behind: Behind, gain: Tensor | None = None) -> Tensor:
    """Mean squared error of sRGB pixels, without the noise of their own rays.

    A noisy pixel's squared error has its variance in it, of which lamps that are too dim and lobes that
    are too sharp have less. Two halves of its rays tell what that is, for they have noise of their own, and
    it is taken away, to first order (docs/decisions/0039). A pixel of one ray has its squared error.

    The prediction is not clipped, so a pixel that is too bright still has a gradient; where the
    photo itself is saturated, anything at least as bright is right.

    Args:
        gain: [R, 1 or 3] of the photos' exposure, or None for 1.
    """
    gain = 1.0 if gain is None else gain
    alpha = batch.alpha[:, None]
    shows_surroundings = isinstance(behind, Surroundings)
    around = linear_to_srgb(gain * behind.behind.detach()) if shows_surroundings else behind
    target = batch.colour * alpha + (1 - alpha) * around

    def predicted(seen: Tensor) -> Tensor:
        radiance, opacity = seen[:, :3], seen[:, 3]
        if shows_surroundings:
            return linear_to_srgb(gain * behind.around(radiance, opacity))
        return over_background(gain * radiance, opacity, behind)

    halves = _halves(buffers)
    error = predicted(halves.mean(1)) - target
    loss = error.square()
    if halves.shape[1] > 1:
        one, other = halves.unbind(1)
        loss = loss - (0.5 * (predicted(one) - predicted(other))).square()
    forgiven = batch.clipped & (error > 0) & (alpha > 0.999)
    return torch.where(forgiven, torch.zeros_like(loss), loss).mean()


def _halves(buffers: RayBuffers) -> Tensor:
    """Radiance and opacity [R, 2, 4] of the halves of a pixel's rays, whose mean is the pixel here, or
    [R, 1, 4] of the pixel itself where nobody asked for halves."""
    if buffers.halves is not None:
        return buffers.halves
    return torch.cat([buffers.radiance, buffers.opacity[:, None]], 1)[:, None]


def total_loss(
    buffers: RayBuffers, batch: RayBatch, settings: FitSettings, use_masks: bool, fraction: float,
    behind: Behind, gain: Tensor | None = None,
) -> tuple[Tensor, dict[str, Tensor]]:  # fmt: skip
    """The weighted sum of what photos and shapes say, and the terms that are worth showing.

    Args:
        use_masks: opacity is held to the photos' alpha, where that is known.
        fraction: how much of the fit is done; smoothness terms fade with it.
        gain: see `photometric`.
    """
    before_colour = isinstance(behind, Tensor) and gain is None
    if before_colour and buffers.bending is not None and at_hand("pixel_loss", buffers.radiance):
        image, shape = _at_once(buffers, batch, settings, use_masks, fraction, behind)
        return image + shape, {"image": image.detach()}
    image = photometric(buffers, batch, behind, gain)
    opacity = _halves(buffers)[..., 3].mean(1)
    loss = image + settings.opacity_weight * opacity.mean()
    loss = loss + settings.orientation_weight * buffers.backfacing.mean()
    if use_masks and settings.mask_weight > 0:
        error = (opacity - batch.alpha) * batch.alpha_known
        loss = loss + settings.mask_weight * error.square().mean()
    if buffers.bending is not None:
        fade = settings.smoothness_end**fraction
        loss = loss + fade * settings.bend_weight * buffers.bending.mean()
        loss = loss + fade * settings.unevenness_weight * buffers.unevenness.mean()
    return loss, {"image": image.detach()}


def _at_once(
    buffers: RayBuffers, batch: RayBatch, settings: FitSettings, use_masks: bool, fraction: float,
    behind: Tensor,
) -> tuple[Tensor, Tensor]:  # fmt: skip
    """The image loss and the rest of `total_loss` in one kernel, of pixels before plain colours."""
    fade = settings.smoothness_end**fraction
    image, shape = rowwise(
        "pixel_loss",
        (_halves(buffers), buffers.backfacing, buffers.bending, buffers.unevenness, batch.colour,
         batch.alpha, batch.alpha_known, batch.clipped, behind),
        (settings.opacity_weight, settings.orientation_weight,
         settings.mask_weight if use_masks else 0.0, fade * settings.bend_weight,
         fade * settings.unevenness_weight),
        ((), ()),
    )  # fmt: skip
    return image.mean(), shape.mean()


def known_of_room(room: Room, directions: Tensor, u: Tensor) -> tuple[Tensor, Tensor]:
    """Radiance [N, 3], linear Rec.709 and no darker than `LEAST_LIGHT`, of what the room has in directions
    [N, 3] from its centre, and its opacity [N] there (see `light_of_room`)."""
    seen, opacity = light_of_room(room, directions, u)
    return (seen / opacity.clamp(min=1e-3)[:, None]).clamp(min=LEAST_LIGHT), opacity


def room_light(scene: Scene, tables: StepTables, random: RandomNumbers, keys: Tensor) -> Tensor:
    """How far the light is from what the room sends to the box's centre, in random directions, by the
    room's opacity (see `light_difference`).

    Args:
        keys: [K] a number per direction.
    """
    directions, u = random_directions(random, keys)
    with torch.no_grad():
        known, opacity = known_of_room(scene.room, directions, u)
    return light_difference(scene, tables, directions, known, opacity)


def light_difference(
    scene: Scene, tables: StepTables, directions: Tensor, known: Tensor, weight: Tensor
) -> Tensor:
    """Mean squared difference between the logarithms of the light in directions [K, 3] and `known` [K, 3]
    radiance, each with its `weight` [K].

    Photos say of a lamp but that it is at least white, so the light may be brighter there.
    """
    texel = scene.environment.texel_solid_angle.mean().to(known)
    light = scene.environment.lookup(tables.light, directions, texel.expand(len(known)))
    error = light.clamp(min=LEAST_LIGHT).log() - known.log()
    forgiven = (known > SATURATED) & (error > 0)
    error = torch.where(forgiven, torch.zeros_like(error), error)
    return (error.square() * weight[:, None]).mean()


def random_directions(random: RandomNumbers, keys: Tensor) -> tuple[Tensor, Tensor]:
    """Directions [K, 3], even over the sphere, and a number [K] in [0, 1) each."""
    u = random.uniform(ROOM_DIRECTION, keys, 3)
    height, turn = 2 * u[:, 0] - 1, 2 * math.pi * u[:, 1]
    level = (1 - height * height).clamp(min=0).sqrt()
    return torch.stack([level * turn.cos(), level * turn.sin(), height], dim=-1), u[:, 2]
