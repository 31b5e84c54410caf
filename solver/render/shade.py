"""Radiance leaving shaded points: diffuse by SH irradiance, specular by secondary rays."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch

from ..brdf.microfacet import (
    fresnel_schlick,
    masking_shadowing_over_masking,
    sample_visible_normal,
    tangent_frame,
    visible_normal_pdf,
)
from ..field.heads import Materials
from ..kernels.march import grid_transmittance
from ..light.environment import irradiance
from .random_numbers import SobolRotations
from .scene import RenderSettings, Scene, StepTables

SELF_SHADOW_VOXELS = 2.0
"""height above its origin from which a secondary ray can be blocked, in voxels of the coarser grid"""


class Shading(NamedTuple):
    """Shaded samples: radiance [S, 3] and what it was made of."""

    radiance: torch.Tensor  # [S, 3] linear Rec.709
    normals: torch.Tensor  # [S, 3] world, unit, outward
    features: torch.Tensor  # [S, F]
    materials: Materials


class SecondaryRays(NamedTuple):
    """Secondary rays in flat form; ray k belongs to sample `sample[k]`."""

    sample: torch.Tensor  # [K] long
    direction: torch.Tensor  # [K, 3] world, unit
    weight: torch.Tensor  # [K, 3] BRDF · cosine / density
    solid_angle: torch.Tensor  # [K] 1 / (N · pdf)
    cosine: torch.Tensor  # [K] of the direction to the normal


def diffuse_fresnel(f0: torch.Tensor, cosine: torch.Tensor) -> torch.Tensor:
    """Share (1 − F) of the light that reaches the diffuse layer [N, 3], averaged over light directions.

    (1 − F0)(1 − s(n·v)) with s the hemispherical mean of (1 − v·h)^5, fitted; within 0.2 % of the
    integral, and what the Cycles material of the asset does.
    """
    s = 0.0271 * (1 - cosine).clamp(0, 1) ** 2.65 + 0.0005
    return (1 - f0) * (1 - s)[:, None]


def allocate_rays(weights: torch.Tensor, rays: int, u: torch.Tensor) -> torch.Tensor:
    """How many of a pixel's `rays` each sample gets: floor(w·M + u), unbiased for u ~ U[0, 1).

    The paper's floor(w·M) leaves every sample with w < 1/M without any (errata).
    """
    return (weights * rays + u).floor().long()


def scatter(
    normals: torch.Tensor, view: torch.Tensor, materials: Materials, features: torch.Tensor,
    counts: torch.Tensor, scene: Scene, settings: RenderSettings, random: SobolRotations,
) -> SecondaryRays:  # fmt: skip
    """Sample `counts` [S] secondary rays at samples with normals facing unit `view` [S, 3]."""
    samples = len(counts)
    sample = torch.repeat_interleave(torch.arange(samples, device=counts.device), counts)
    index = torch.arange(len(sample), device=counts.device) - (counts.cumsum(0) - counts)[sample]
    tangent, bitangent = tangent_frame(normals)
    frame = torch.stack([tangent, bitangent, normals], dim=1)
    local_view = torch.einsum("nij,nj->ni", frame, view)
    local_view = torch.cat([local_view[:, :2], local_view[:, 2:].clamp(min=1e-3)], dim=-1)
    local_view = local_view / local_view.norm(dim=-1, keepdim=True)

    local_view, frame = local_view[sample], frame[sample]
    alpha, f0 = materials.alpha[sample], materials.f0[sample]
    half = sample_visible_normal(local_view, alpha, random.draw(sample, index, samples))
    view_half = (local_view * half).sum(-1)
    light = 2 * view_half[:, None] * half - local_view
    above = light[:, 2] > 1e-4

    weight = fresnel_schlick(f0, view_half)
    if settings.light_masking:
        shadowing = masking_shadowing_over_masking(local_view[:, 2], light[:, 2], alpha)
        weight = weight * shadowing[:, None]
    if settings.neural > 0:
        g = scene.neural(features[sample], half, light, alpha)
        weight = weight * (1 + settings.neural * (g - 1))
    weight = weight * above[:, None]
    with torch.no_grad():
        pdf = visible_normal_pdf(local_view[:, 2], half[:, 2], alpha)
        solid_angle = 1 / (counts[sample] * pdf).clamp(min=1e-6)
    direction = torch.einsum("nij,ni->nj", frame, light)
    direction = direction / direction.norm(dim=-1, keepdim=True)
    return SecondaryRays(sample, direction, weight, solid_angle, light[:, 2].detach())


def secondary_visibility(
    scene: Scene, box_points: torch.Tensor, normals: torch.Tensor, rays: SecondaryRays
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Transmittance [K] of the secondary rays through the occupancy grid, no gradient.

    Returns it with the origins [K, 3] (box units, lifted off the surface) and the distances [K]
    from which the rays are traced.
    """
    field, occupancy = scene.field, scene.occupancy
    with torch.no_grad():
        cell = 2 * field.half_size / occupancy.cells
        lift = SELF_SHADOW_VOXELS * max(cell, field.voxel)
        origins = (box_points + field.directions_to_box(lift * normals))[rays.sample]
        start = (lift * (1 / rays.cosine.clamp(min=0.2) - 1)).clamp(max=4 * lift)
        directions = field.directions_to_box(rays.direction)
        passing = grid_transmittance(origins, directions, start, cell, occupancy.extinction * cell)
    return passing, origins, start


def choose_retraced(
    scores: torch.Tensor, budget: int, u: float
) -> tuple[torch.Tensor, torch.Tensor]:
    """Systematic sampling of about `budget` rays by score: indices and their probabilities.

    Dividing what a chosen ray brings by its probability keeps the estimate unbiased.
    """
    total = scores.sum()
    if budget <= 0 or total <= 0:
        empty = torch.zeros(0, dtype=torch.long, device=scores.device)
        return empty, scores.new_zeros(0)
    candidates = (scores > 0).nonzero()[:, 0]
    if len(candidates) <= budget:
        return candidates, torch.ones_like(scores[candidates])
    probability = (scores * (budget / total)).clamp(max=1)
    running = (probability.double().cumsum(0) + u).floor()
    chosen = torch.diff(running, prepend=running.new_zeros(1)) > 0
    indices = chosen.nonzero()[:, 0]
    return indices, probability[indices]


def shade(
    scene: Scene, tables: StepTables, settings: RenderSettings, random: SobolRotations,
    box_points: torch.Tensor, view: torch.Tensor, weights: torch.Tensor, rays: int, trace=None,
) -> Shading:  # fmt: skip
    """Shade samples at `box_points` [S, 3] seen along unit `view` [S, 3] (towards the viewer).

    Args:
        weights: [S] volume rendering weights, which share out the rays.
        rays: secondary rays a pixel.
        trace: traces secondary rays through the field: (origins, directions, start) → (radiance
            [K, 3], transmittance [K]); None at the last bounce.
    """
    field = scene.field
    normals = field.normals(box_points, tables.normal_factors)
    features = field.features(box_points)
    materials = field.materials(features)
    facing = (normals * view).sum(-1, keepdim=True)
    toward = torch.where(facing < 0, -normals, normals)

    diffuse = diffuse_fresnel(materials.f0, facing[:, 0].abs()) * materials.albedo
    radiance = diffuse * irradiance(tables.light, normals) / math.pi

    expected = weights.detach() * rays
    counts = allocate_rays(weights.detach(), rays, random.uniform(len(weights)))
    secondary = scatter(toward, view, materials, features, counts, scene, settings, random)
    if len(secondary.sample) == 0:
        return Shading(radiance, normals, features, materials)
    incident = scene.environment.lookup(tables.light, secondary.direction, secondary.solid_angle)
    # A sample that was lucky to get its one ray stands for the others like it.
    share = (1 / expected.clamp(max=1).clamp(min=1e-6))[secondary.sample] / counts[secondary.sample]
    throughput = secondary.weight * share[:, None]
    if settings.visibility:
        passing, origins, start = secondary_visibility(scene, box_points, toward, secondary)
        incident = incident * passing[:, None]
        if trace is not None and settings.retraced_rays > 0:
            scores = (1 - passing) * throughput.detach().amax(-1)
            scores = scores * weights.detach()[secondary.sample]
            scores = torch.where(passing < 0.95, scores, torch.zeros_like(scores))
            chosen, probability = choose_retraced(
                scores, settings.retraced_rays, float(random.uniform(1))
            )
            if len(chosen):
                bounced, _ = trace(origins[chosen], secondary.direction[chosen], start[chosen])
                incident = incident.index_add(0, chosen, bounced / probability[:, None])
    radiance = radiance.index_add(0, secondary.sample, throughput * incident)
    return Shading(radiance, normals, features, materials)
