"""How unlike its surroundings a surface is: bends of its normals, steps of its materials."""

import torch
from torch import Tensor

from ..field.heads import Materials
from ..kernels.pointwise import at_hand, rowwise
from .random_numbers import NEIGHBOUR, RandomNumbers
from .scene import RenderSettings, Samples, Scene, StepTables
from .shade import Shading

GLOSS_ROUGHNESS = 0.15
"""roughness r at which a surface's normals are held together e times less than a mirror's"""
SAME_COLOUR = 0.05
"""step of albedo and F0 over which a surface is e times less of one material"""
EVEN_ROUGHNESS = 5.0
"""how much more a step of roughness counts within one material than between two"""
EVEN_F0 = 5.0
"""how much more a step of F0 counts than one of albedo: things have fewer metals than colours"""
CREASE = 0.063
"""angle, rad, by which a lone normal has to be off to count half as much as any edge does (3.6°)"""


def saturating(square: Tensor, spread: float) -> Tensor:
    """x²/(x² + s²) in [0, 1) of squares x²: nearly quadratic below the spread s, nearly one beyond it.

    Geman & McClure's robust function: what is far away is left alone.
    """
    return square / (square + spread**2)


def smoothness(
    scene: Scene, tables: StepTables, settings: RenderSettings, random: RandomNumbers,
    samples: Samples, shading: Shading,
) -> tuple[Tensor, Tensor]:  # fmt: skip
    """Bending and unevenness, each [S] ≥ 0, of shaded samples [S].

    Both look at a random point close by (see `unevenness`); bending at its mirror image beyond the sample
    as well (see `bending`). It counts by gloss, e^(−r/0.15), r without gradient: the sharper a reflection,
    the more a bent normal shows, and the less it is held by the photos' shading (docs/decisions/0007).
    """
    spread = settings.neighbour_distance * scene.field.voxel
    offset = (random.uniform(NEIGHBOUR, samples.keys, 3) - 0.5) * (2 * 3**0.5 * spread)
    near = scene.surface(samples.points + offset, samples.part, tables.normals)
    beyond = scene.surface_normals(samples.points - offset, samples.part, tables.normals)
    if at_hand("smoothness", shading.normals):
        here, there = shading.materials, near.materials
        return rowwise(
            "smoothness",
            (shading.normals, near.normals, beyond, here.alpha, there.alpha, here.albedo, there.albedo,
             here.f0, there.f0),
            (GLOSS_ROUGHNESS, CREASE, SAME_COLOUR, EVEN_ROUGHNESS, EVEN_F0), ((), ()),
        )  # fmt: skip
    gloss = torch.exp(-shading.materials.alpha.detach().sqrt() / GLOSS_ROUGHNESS)
    bends = gloss * bending(shading.normals, near.normals, beyond)
    return bends, unevenness(shading.materials, near.materials)


def bending(here: Tensor, near: Tensor, beyond: Tensor) -> Tensor:
    """How unevenly a surface bends [S] in [0, 1), from unit normals [S, 3] at a point and at two others,
    equally far from it on opposite sides.

    x² = |n₊ + n₋ − 2n|²/4 is nothing where a surface is flat or evenly round, and the square of the angle
    where only n is off; edges, whose x is large, are left as they are (docs/decisions/0016).
    """
    square = 0.25 * (near + beyond - 2 * here).square().sum(-1)
    return saturating(square, CREASE)


def unevenness(here: Materials, near: Materials) -> Tensor:
    """By how much materials differ [S] from those close by: the steps of albedo, F0 and roughness r.

    A step of F0 counts `EVEN_F0` times, for in a pixel that shows two colours a thin metal fits as well as
    their mixture (docs/decisions/0045). Where colours stay, a step of roughness counts `EVEN_ROUGHNESS`
    times, without gradient to the colours: photos tell little of roughness but in highlights, and what is
    of one colour is mostly of one gloss (docs/decisions/0017).
    """
    of_albedo = (near.albedo - here.albedo).abs().mean(-1)
    of_f0 = (near.f0 - here.f0).abs().mean(-1)
    one_material = torch.exp(-(of_albedo + of_f0).detach() / SAME_COLOUR)
    counts = 1 + (EVEN_ROUGHNESS - 1) * one_material
    of_roughness = (near.alpha.sqrt() - here.alpha.sqrt()).abs()
    return of_albedo + EVEN_F0 * of_f0 + counts * of_roughness
