"""Rays to pixels: march, composite, shade; and the secondary rays that do the same once more."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from ..kernels.march import composite
from .depths import all_depths, random_depths
from .random_numbers import (
    DEPTH,
    NEIGHBOUR,
    OFFSET,
    SECONDARY_DEPTH,
    SECONDARY_OFFSET,
    RandomNumbers,
)
from .scene import RenderSettings, Samples, Scene, StepTables
from .shade import shade

SECONDARY_MIN_WEIGHT = 5.0
"""threshold of shading at the end of retraced rays, in units of `RenderSettings.min_weight`"""
GLOW_MIN_WEIGHT = 5e-4
"""samples of a plain radiance field that weigh less are not looked at; a fog has many light ones"""
RAYS_PER_TRACE = 65536
"""retraced rays at once where no gradient is wanted; bounds the memory"""

GLOSS_ROUGHNESS = 0.15
"""roughness r at which a surface's normals are held together e times less than a mirror's"""


@dataclass
class RayBuffers:
    """What R rays saw. All premultiplied by opacity where it says so."""

    radiance: torch.Tensor  # [R, 3] linear Rec.709, premultiplied
    opacity: torch.Tensor  # [R]
    normal: torch.Tensor  # [R, 3] world, premultiplied
    albedo: torch.Tensor  # [R, 3] linear, premultiplied
    alpha: torch.Tensor  # [R] GGX α, premultiplied
    f0: torch.Tensor  # [R, 3] linear, premultiplied
    backfacing: torch.Tensor  # [R] Σ w·max(0, n·d)² (orientation loss, Ref-NeRF eq. 11)
    distance: torch.Tensor  # [R] mean distance, premultiplied, no gradient
    samples: int  # density samples taken by primary rays
    retraced: int  # secondary rays traced through the field
    retraced_samples: int  # density samples they took
    bending: torch.Tensor | None = None  # [R] Σ w·gloss·(1 − n·n'), n' the normal close by
    unevenness: torch.Tensor | None = None  # [R] Σ w·|materials − materials close by|


def render_rays(
    scene: Scene, tables: StepTables, settings: RenderSettings, random: RandomNumbers,
    origins: torch.Tensor, directions: torch.Tensor, keys: torch.Tensor, jitter: bool,
    pixel_angle: torch.Tensor | None = None,
) -> RayBuffers:  # fmt: skip
    """Trace primary rays (origins, unit directions [R, 3], world).

    Args:
        scene: a `Scene` or a `Composition`.
        keys: [R] a number per ray, such as its pixel's; equal keys get equal random numbers.
        jitter: a random offset of the samples of each ray (training); else half a step.
        pixel_angle: [R] angular width of each ray's pixel, rad; None: rays have no width.
    """
    count = len(origins)
    offset = random.uniform(OFFSET, keys) if jitter else origins.new_full((count,), 0.5)
    near = origins.new_zeros(count)
    samples = scene.sample(
        origins, directions, keys, near, offset, settings.step, settings.min_transmittance
    )
    weights, transmittance = composite(samples.depth, samples.offsets)
    ray = samples.ray
    traced = [0, 0]

    def trace(origins, directions, keys, start):
        radiance, passing, taken = _trace_secondary(
            scene, tables, settings, random, origins, directions, keys, start
        )
        traced[0], traced[1] = traced[0] + len(origins), traced[1] + taken
        return radiance, passing

    if settings.emission >= 1:
        # A fog's colours cost little, and chosen at random they would hardly tell where it is dense.
        chosen = all_depths(weights, ray, 1 - transmittance, GLOW_MIN_WEIGHT)
    elif settings.shaded_depths > 0:
        u = random.uniform(DEPTH, keys, settings.shaded_depths).view(count, -1)
        chosen = random_depths(weights, samples.offsets, ray, 1 - transmittance, u)
    else:
        chosen = all_depths(weights, ray, 1 - transmittance, settings.min_weight)
    kept = _only(samples, chosen.index)
    view = -directions[kept.ray]
    shading = shade(
        scene, tables, settings, random, kept, view, chosen.mass, settings.secondary_rays, trace,
        pixel_angle,
    )  # fmt: skip
    gather = chosen.gather
    away = -(shading.normals * view).sum(-1)
    materials = shading.materials
    with torch.no_grad():
        distance = torch.zeros_like(near).index_add(0, ray, weights * samples.distance)
    bending = unevenness = None
    if settings.neighbour_distance > 0 and settings.emission < 1:
        away_normal, difference = _neighbours(scene, tables, settings, random, kept, shading)
        bending, unevenness = gather(away_normal), gather(difference)
    return RayBuffers(
        radiance=gather(shading.radiance),
        opacity=1 - transmittance,
        normal=gather(shading.normals),
        albedo=gather(materials.albedo),
        alpha=gather(materials.alpha),
        f0=gather(materials.f0),
        backfacing=gather(away.clamp(min=0) ** 2),
        distance=distance,
        samples=len(ray),
        retraced=traced[0],
        retraced_samples=traced[1],
        bending=bending,
        unevenness=unevenness,
    )


def _only(samples: Samples, kept: torch.Tensor) -> Samples:
    """The samples at indices `kept` [K]; offsets no longer hold."""
    part = None if samples.part is None else samples.part[kept]
    return Samples(
        samples.points[kept], samples.depth[kept], samples.distance[kept], samples.ray[kept],
        samples.keys[kept], samples.offsets[:0], part,
    )  # fmt: skip


def _neighbours(scene, tables, settings, random, samples, shading):
    """How much normals and materials [S] differ from those at a random point close by.

    Normals count by gloss, e^(−r/0.15): the sharper a reflection, the more a bent normal shows, and
    the less it is held by the photos' shading.
    """
    spread = settings.neighbour_distance * scene.field.voxel
    offset = (random.uniform(NEIGHBOUR, samples.keys, 3) - 0.5) * (2 * 3**0.5 * spread)
    near = scene.surface(samples.points + offset, samples.part, tables.normals)
    other, here = near.materials, shading.materials
    gloss = torch.exp(-here.alpha.detach().sqrt() / GLOSS_ROUGHNESS)
    bend = gloss * (1 - (near.normals * shading.normals).sum(-1))
    difference = (
        (other.albedo - here.albedo).abs().mean(-1)
        + (other.alpha.sqrt() - here.alpha.sqrt()).abs()
        + (other.f0 - here.f0).abs().mean(-1)
    )
    return bend, difference


def _trace_secondary(scene, tables, settings, random, origins, directions, keys, start):
    """Radiance [K, 3] (premultiplied), transmittance [K] of secondary rays; density samples taken.

    Rays carry the path's gradient in their direction only through what they meet.
    """
    if not torch.is_grad_enabled() and len(origins) > RAYS_PER_TRACE:
        pieces = [
            _trace_secondary(scene, tables, settings, random, *piece)
            for piece in zip(
                *(v.split(RAYS_PER_TRACE) for v in (origins, directions, keys, start)), strict=True
            )
        ]
        radiance, passing, taken = zip(*pieces, strict=True)
        return torch.cat(radiance), torch.cat(passing), sum(taken)
    samples = scene.sample(
        origins.detach(), directions.detach(), keys, start,
        random.uniform(SECONDARY_OFFSET, keys), settings.secondary_step,
        settings.min_transmittance,
    )  # fmt: skip
    weights, transmittance = composite(samples.depth, samples.offsets)
    ray = samples.ray
    if settings.secondary_depths > 0:
        u = random.uniform(SECONDARY_DEPTH, keys, settings.secondary_depths).view(len(keys), -1)
        chosen = random_depths(weights, samples.offsets, ray, 1 - transmittance, u)
    else:
        least = SECONDARY_MIN_WEIGHT * settings.min_weight
        chosen = all_depths(weights, ray, 1 - transmittance, least)
    kept = _only(samples, chosen.index)
    shading = shade(
        scene, tables, settings, random, kept, -directions[kept.ray], chosen.mass,
        settings.secondary_bounce_rays,
    )  # fmt: skip
    return chosen.gather(shading.radiance), transmittance, len(ray)
