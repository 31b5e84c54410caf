"""Rays to pixels: march, composite, shade; and the secondary rays that do the same once more."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from ..kernels.march import composite, march
from .random_numbers import SobolRotations
from .scene import RenderSettings, Scene, StepTables
from .shade import shade


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
    samples: int  # density samples taken
    bending: torch.Tensor | None = None  # [R] Σ w·(1 − n·n'), n' the normal close by
    unevenness: torch.Tensor | None = None  # [R] Σ w·|materials − materials close by|


def render_rays(
    scene: Scene, tables: StepTables, settings: RenderSettings, random: SobolRotations,
    origins: torch.Tensor, directions: torch.Tensor, jitter: bool,
) -> RayBuffers:  # fmt: skip
    """Trace primary rays (origins, unit directions [R, 3], world).

    Args:
        jitter: a random offset of the samples of each ray (training); else half a step.
    """
    field = scene.field
    box_origins, box_directions = field.to_box(origins), field.directions_to_box(directions)
    count = len(origins)
    offset = random.uniform(count) if jitter else origins.new_full((count,), 0.5)
    near = origins.new_zeros(count)
    sampled = _sample(scene, settings, box_origins, box_directions, near, offset, settings.step)
    box_points, ray, weights, transmittance, segments = sampled

    def trace(origins, directions, start):
        return _trace_secondary(scene, tables, settings, random, origins, directions, start)

    kept = (weights.detach() > settings.min_weight).nonzero()[:, 0]
    shaded_ray, shaded_weight = ray[kept], weights[kept]
    view = -directions[shaded_ray]
    shading = shade(
        scene, tables, settings, random, box_points[kept], view, shaded_weight,
        settings.secondary_rays, trace,
    )  # fmt: skip
    shaded_weight = shaded_weight * _make_up(weights, kept, ray, count)[shaded_ray]

    def gather(values: torch.Tensor) -> torch.Tensor:
        weighted = values * (shaded_weight[:, None] if values.dim() == 2 else shaded_weight)
        return values.new_zeros((count, *values.shape[1:])).index_add(0, shaded_ray, weighted)

    away = -(shading.normals * view).sum(-1)
    materials = shading.materials
    with torch.no_grad():
        distance = torch.zeros_like(near).index_add(0, ray, weights * segments.distance)
    bending = unevenness = None
    if settings.neighbour_distance > 0:
        away_normal, difference = _neighbours(
            scene, tables, settings, random, box_points[kept], shading
        )
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
        bending=bending,
        unevenness=unevenness,
    )


def _neighbours(scene, tables, settings, random, box_points, shading):
    """How much normals and materials [S] differ from those at a random point close by."""
    field = scene.field
    spread = settings.neighbour_distance / (field.size - 1)
    offset = (random.uniform(len(box_points), 3) - 0.5) * (2 * 3**0.5 * spread)
    near = (box_points.detach() + offset).clamp(0, 1)
    bend = 1 - (field.normals(near, tables.normal_factors) * shading.normals).sum(-1)
    other = field.materials(field.features(near))
    here = shading.materials
    difference = (
        (other.albedo - here.albedo).abs().mean(-1)
        + (other.alpha.sqrt() - here.alpha.sqrt()).abs()
        + (other.f0 - here.f0).abs().mean(-1)
    )
    return bend, difference


def _sample(scene, settings, box_origins, box_directions, start, offset, step_voxels):
    """Density samples and their weights along rays in box units."""
    field = scene.field
    step = step_voxels * field.voxel
    segments = march(
        box_origins, box_directions, start, offset, step, scene.occupancy.occupied,
        field.density_planes, field.density_lines, field.density_shift, field.density_scale,
        settings.min_transmittance,
    )  # fmt: skip
    ray = segments.ray
    box_points = box_origins[ray] + segments.distance[:, None] * box_directions[ray]
    depth = field.extinction(field.raw_density(box_points)) * step
    weights, transmittance = composite(depth, segments.offsets)
    return box_points, ray, weights, transmittance, segments


def _make_up(weights, kept, ray, count):
    """Factor [R] by which the shaded samples stand for the ones too faint to be shaded."""
    with torch.no_grad():
        total = torch.zeros(count, device=weights.device).index_add(0, ray, weights)
        shaded = torch.zeros_like(total).index_add(0, ray[kept], weights[kept])
        return (total / shaded.clamp(min=1e-6)).clamp(max=2.0)


def _trace_secondary(scene, tables, settings, random, box_origins, directions, start):
    """Radiance [K, 3] (premultiplied) and transmittance [K] of secondary rays, last bounce."""
    field = scene.field
    box_directions = field.directions_to_box(directions)
    offset = random.uniform(len(directions))
    box_points, ray, weights, transmittance, _ = _sample(
        scene, settings, box_origins.detach(), box_directions.detach(), start, offset,
        settings.secondary_step,
    )  # fmt: skip
    kept = (weights.detach() > 5 * settings.min_weight).nonzero()[:, 0]
    shaded_ray = ray[kept]
    shading = shade(
        scene, tables, settings, random, box_points[kept], -directions[shaded_ray],
        weights[kept], settings.secondary_bounce_rays,
    )  # fmt: skip
    weight = weights[kept] * _make_up(weights, kept, ray, len(directions))[shaded_ray]
    radiance = directions.new_zeros(len(directions), 3)
    return radiance.index_add(0, shaded_ray, shading.radiance * weight[:, None]), transmittance
