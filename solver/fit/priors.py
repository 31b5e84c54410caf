"""What things are usually made of, and lit by, for where photos leave it open; terms of the loss.

They count as far as points reflect light instead of shining by themselves.
"""

import torch
from torch import Tensor

from ..brdf.microfacet import DIELECTRIC_F0, SURE_DIELECTRIC_F0
from ..kernels.pointwise import at_hand, rowwise
from ..light.environment import LightTables
from ..render.radiance import RayBuffers
from ..render.smoothness import saturating
from .settings import FitSettings

DIELECTRIC_SPREAD = 0.02
"""of F0 among what is no metal"""
METAL_F0 = 0.9
"""of the brightest channel of metals that people photograph: silver, gold, copper, aluminium, brass"""
LEAST_METAL_F0, SURE_METAL_F0, METAL_SPREAD = 0.3, 0.6, 0.05
"""where metals begin, where they are sure, and how softly"""
COOL_SPREAD = 0.65
"""share of the brightest channel by which an F0 is green or blue that no longer is a bare metal's; chrome
under a light that came out too warm is so by 0.3"""
COLOUR_SPREAD = 0.2
"""of albedos that may be one and the same at the start, as a share of the mean of all"""
LEAST_OPACITY = 0.1
"""of pixels at the object's edge, which else would have materials far brighter than any"""


def of_materials(buffers: RayBuffers, settings: FitSettings, fraction: float) -> Tensor:
    """The weighted sum of all terms below, at a fraction of the fit."""
    loss = buffers.opacity.new_zeros(())
    if settings.palette_weight > 0:
        weight = settings.palette_weight * settings.palette_end**fraction
        spread = COLOUR_SPREAD * settings.palette_narrowing**fraction
        loss = loss + weight * off_palette(buffers, spread)
    if settings.roughness_weight > 0:
        loss = loss + (1 - fraction) * settings.roughness_weight * buffers.alpha.mean()
    if fraction < settings.f0_start:
        return loss
    grey = settings.grey_f0_weight if fraction >= settings.grey_f0_start else 0.0
    if at_hand("material_priors", buffers.f0):
        return loss + _of_materials_at_once(buffers, settings, grey)
    if settings.dielectric_weight > 0:
        loss = loss + settings.dielectric_weight * unlike_dielectric(buffers)
    if grey > 0:
        loss = loss + grey * coloured_dielectric(buffers)
    if settings.metal_weight > 0:
        loss = loss + settings.metal_weight * unlike_metal(buffers)
    if settings.metal_albedo_weight > 0:
        loss = loss + settings.metal_albedo_weight * diffuse_metal(buffers)
    return loss


def _of_materials_at_once(buffers: RayBuffers, settings: FitSettings, grey: float) -> Tensor:
    """What `of_materials` has of those that tell metals from dielectrics, in one kernel."""
    (loss,) = rowwise(
        "material_priors", (buffers.albedo, buffers.f0, buffers.opacity.detach()),
        (LEAST_OPACITY, settings.dielectric_weight, DIELECTRIC_F0, DIELECTRIC_SPREAD, grey,
         LEAST_METAL_F0, SURE_DIELECTRIC_F0, settings.metal_weight, METAL_F0, COOL_SPREAD, METAL_SPREAD,
         settings.metal_albedo_weight, SURE_METAL_F0),
        ((),),
    )  # fmt: skip
    return loss.mean()


def unlike_dielectric(buffers: RayBuffers) -> Tensor:
    """Mean of x²/(x² + s²) in [0, 1), x = F0 − 0.04: it pulls what is close, and leaves metals alone."""
    usual = DIELECTRIC_F0 * buffers.opacity.detach()[:, None]
    return saturating((buffers.f0 - usual).square(), DIELECTRIC_SPREAD).mean()


def coloured_dielectric(buffers: RayBuffers) -> Tensor:
    """Mean of (F0 − its mean over channels)², over what is no metal: only metals reflect in a colour.

    All of it counts up to an F0 of 0.2, nothing from 0.3 on; that has no gradient.
    """
    f0 = _straight(buffers.f0, buffers.opacity)
    room = LEAST_METAL_F0 - f0.detach().amax(-1)
    dielectric = (room / (LEAST_METAL_F0 - SURE_DIELECTRIC_F0)).clamp(0, 1)
    colour = (f0 - f0.mean(-1, keepdim=True)).square().mean(-1)
    return (buffers.opacity.detach() * dielectric * colour).mean()


def unlike_metal(buffers: RayBuffers) -> Tensor:
    """Mean of (F0 − 0.9)² of the brightest channel, over what is metal, which F0 above 0.3 is.

    All channels are moved alike, whichever is the brightest, so that the pull has no colour. Bare metals
    are grey or warm, as gold, copper and bronze are; what reflects green or blue is anodised or painted, as
    bright as it may be, and left alone.
    """
    f0 = _straight(buffers.f0, buffers.opacity)
    brightest = f0.detach().amax(-1)
    bare = torch.exp(-((_coolness(f0.detach()) / COOL_SPREAD) ** 6))
    metal = bare * _above(brightest, LEAST_METAL_F0)
    missing = METAL_F0 - brightest - (f0 - f0.detach()).mean(-1)
    return (metal * missing.square()).mean()


def diffuse_metal(buffers: RayBuffers) -> Tensor:
    """Mean of albedo² over what is surely metal, which has none; without gradient to F0."""
    metal = _above(_straight(buffers.f0, buffers.opacity).detach().amax(-1), SURE_METAL_F0)
    return (metal * _straight(buffers.albedo, buffers.opacity).square().mean(-1)).mean()


def off_palette(buffers: RayBuffers, spread: float = COLOUR_SPREAD) -> Tensor:
    """How much albedos of pairs of pixels differ that may be of one colour, in [0, 1).

    Mean of x²/(x² + s²), x the root mean square difference over channels, as a share of the mean albedo,
    so that a darker object is no better than a brighter one; s is the `spread`. Pairs are half a batch
    apart, which is anywhere on the object: an object has few colours, wherever they are; shadows, bounces
    and highlights left over in the albedo have many. Metals do not count: what is left of their albedo
    would take on the colour of the rest. Low entropy of reflectance is the parsimony of Barron and Malik
    (2015), doi:10.1109/TPAMI.2014.2377712. See docs/decisions/0017 and 0046.
    """
    metal = _above(_straight(buffers.f0, buffers.opacity).detach().amax(-1), LEAST_METAL_F0)
    share = buffers.opacity.detach() * (1 - metal)
    albedo = _straight(buffers.albedo, buffers.opacity)
    mean = (share[:, None] * albedo).mean() / share.mean().clamp(min=LEAST_OPACITY)
    half = len(share) // 2
    if at_hand("off_palette", albedo):
        inputs = albedo, mean.view(1), share
        return rowwise("off_palette", inputs, (spread, half), ((),))[0].mean()
    square = (albedo - albedo.roll(half, 0)).square().mean(-1) / mean.square().clamp(min=1e-6)
    return (share * share.roll(half) * saturating(square, spread)).mean()


def coloured_light(tables: LightTables) -> Tensor:
    """Mean square of how far the logarithms of a light's three channels, each its mean over all directions,
    are from their mean.

    Photos show products of light and surface: a light that is too blue looks the same with an object that
    is too yellow. Colours of whole lights differ little, for cameras are balanced for them. This is the
    grey world of Buchsbaum (1980), doi:10.1016/0016-0032(80)90058-7, asked of the light, not of the photo.
    """
    channels = tables.irradiance[0, 0].log()
    return (channels - channels.mean()).square().mean()


def _coolness(f0: Tensor) -> Tensor:
    """By how much F0 [R, 3] has more green than red, or more blue than the less of both, as a share of its
    brightest channel [R], at least 0."""
    red, green, blue = f0.unbind(-1)
    excess = torch.maximum(green - red, blue - torch.minimum(red, green))
    return excess.clamp(min=0) / f0.amax(-1).clamp(min=1e-3)


def _above(f0: Tensor, least: float) -> Tensor:
    return torch.sigmoid((f0 - least) / METAL_SPREAD)


def _straight(value: Tensor, opacity: Tensor) -> Tensor:
    """[R, 3] not premultiplied any more; opacity has no gradient."""
    return value / opacity.detach().clamp(min=LEAST_OPACITY)[:, None]
