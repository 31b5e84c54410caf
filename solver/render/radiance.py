"""Rays to pixels: march, composite, shade; and the secondary rays that do the same once more."""

from dataclasses import dataclass

import torch
from torch import Tensor

from ..kernels.march import composite
from .depths import Depths, all_depths, random_depths
from .random_numbers import DEPTH, OFFSET, SECONDARY_DEPTH, SECONDARY_OFFSET, RandomNumbers, sample_keys
from .scene import RenderSettings, Samples, Scene, Steps, StepTables
from .shade import shade
from .smoothness import smoothness

SECONDARY_MIN_WEIGHT = 5.0
"""threshold of shading at the end of retraced rays, in units of `RenderSettings.min_weight`"""
GLOW_MIN_WEIGHT = 5e-4
"""samples of a plain radiance field that weigh less are not looked at; a fog has many light ones"""
RAYS_PER_TRACE = 65536
"""retraced rays at once where no gradient is wanted; bounds the memory"""


@dataclass
class RayBuffers:
    """What R rays saw. All premultiplied by opacity where it says so."""

    radiance: Tensor  # [R, 3] linear Rec.709, premultiplied
    opacity: Tensor  # [R]
    normal: Tensor  # [R, 3] world, premultiplied
    albedo: Tensor  # [R, 3] linear, premultiplied
    alpha: Tensor  # [R] GGX α, premultiplied
    f0: Tensor  # [R, 3] linear, premultiplied
    backfacing: Tensor  # [R] Σ w·max(0, n·d)² (orientation loss, Ref-NeRF eq. 11)
    distance: Tensor  # [R] mean distance, premultiplied, no gradient
    samples: int  # density samples taken by primary rays
    retraced: int  # secondary rays traced through the field
    retraced_samples: int  # density samples they took
    bending: Tensor | None = None  # [R] Σ w·bending of the samples (see `smoothness`)
    unevenness: Tensor | None = None  # [R] Σ w·|materials − materials close by|
    halves: Tensor | None = None  # [R, 2, 4] radiance and opacity of a pixel's halves


def render_rays(
    scene: Scene, tables: StepTables, settings: RenderSettings, random: RandomNumbers,
    origins: Tensor, directions: Tensor, keys: Tensor, jitter: bool,
    pixel_angle: Tensor | None = None,
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
    steps = scene.sample(origins, directions, near, offset, settings.step, settings.min_transmittance)
    weights, transmittance = composite(steps.depth, steps.offsets)
    ray = steps.ray
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
        depths = settings.shaded_depths
        u = random.uniform(DEPTH, keys, depths).view(count, depths)
        chosen = random_depths(weights, steps.offsets, 1 - transmittance, u)
    else:
        chosen = all_depths(weights, ray, 1 - transmittance, settings.min_weight)
    kept = _samples(steps, chosen, origins, directions, keys)
    view = -directions[kept.ray]
    shading = shade(
        scene, tables, settings, random, kept, view, chosen.mass, settings.secondary_rays, trace,
        pixel_angle,
    )  # fmt: skip
    away = -(shading.normals * view).sum(-1)
    materials = shading.materials
    shown = {
        "radiance": shading.radiance, "normal": shading.normals, "albedo": materials.albedo,
        "alpha": materials.alpha, "f0": materials.f0, "backfacing": away.clamp(min=0) ** 2,
    }  # fmt: skip
    if settings.neighbour_distance > 0 and settings.emission < 1:
        shown["bending"], shown["unevenness"] = smoothness(scene, tables, settings, random, kept, shading)
    with torch.no_grad():
        distance = torch.zeros_like(near).index_add(0, ray, weights * steps.distance)
    return RayBuffers(
        opacity=1 - transmittance, distance=distance, samples=len(ray), retraced=traced[0],
        retraced_samples=traced[1], **_seen(chosen, shown),
    )  # fmt: skip


def _seen(chosen: Depths, shown: dict[str, Tensor]) -> dict[str, Tensor]:
    """What rays see of what the chosen samples show, [K] or [K, C] each; all gathered at once."""
    columns = [value if value.dim() > 1 else value[:, None] for value in shown.values()]
    seen = chosen.gather(torch.cat(columns, 1)).split([c.shape[1] for c in columns], 1)
    return {
        name: column if value.dim() > 1 else column[:, 0]
        for (name, value), column in zip(shown.items(), seen, strict=True)
    }


def _samples(steps: Steps, chosen: Depths, origins: Tensor, directions: Tensor, keys: Tensor) -> Samples:
    """The chosen steps along rays of the given origins, directions [R, 3] and keys [R]."""
    index, ray = chosen.index, steps.ray[chosen.index]
    distance = steps.distance[index]
    points = origins[ray] + distance[:, None] * directions[ray]
    part = None if steps.part is None else steps.part[index]
    return Samples(points, distance, ray, sample_keys(keys, ray, index, steps.offsets), part)


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
    steps = scene.sample(
        origins.detach(), directions.detach(), start, random.uniform(SECONDARY_OFFSET, keys),
        settings.secondary_step, settings.min_transmittance,
    )  # fmt: skip
    weights, transmittance = composite(steps.depth, steps.offsets)
    ray = steps.ray
    if settings.secondary_depths > 0:
        depths = settings.secondary_depths
        u = random.uniform(SECONDARY_DEPTH, keys, depths).view(len(keys), depths)
        chosen = random_depths(weights, steps.offsets, 1 - transmittance, u)
    else:
        least = SECONDARY_MIN_WEIGHT * settings.min_weight
        chosen = all_depths(weights, ray, 1 - transmittance, least)
    kept = _samples(steps, chosen, origins.detach(), directions.detach(), keys)
    view = -directions.index_select(0, kept.ray)
    shading = shade(
        scene, tables, settings, random, kept, view, chosen.mass, settings.secondary_bounce_rays
    )
    return chosen.gather(shading.radiance), transmittance, len(ray)
