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
from ..light.environment import irradiance
from .random_numbers import ALLOCATION, CHOICE, RandomNumbers
from .scene import RenderSettings, Samples, Scene, StepTables, Surface

RAYS_PER_SAMPLE = 1024
"""room for the secondary rays of a sample in a key"""


class Shading(NamedTuple):
    """Shaded samples: radiance [S, 3] and what it was made of."""

    radiance: torch.Tensor  # [S, 3] linear Rec.709
    normals: torch.Tensor  # [S, 3] world, unit, outward
    features: torch.Tensor  # [S, F]
    materials: Materials


class SecondaryRays(NamedTuple):
    """Secondary rays in flat form; ray k belongs to sample `sample[k]`."""

    sample: torch.Tensor  # [K] long
    keys: torch.Tensor  # [K] long
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
    surface: Surface, normals: torch.Tensor, view: torch.Tensor, samples: Samples,
    counts: torch.Tensor, scene: Scene, settings: RenderSettings, random: RandomNumbers,
) -> SecondaryRays:  # fmt: skip
    """Sample `counts` [S] secondary rays at samples with `normals` facing unit `view` [S, 3]."""
    materials, features = surface.materials, surface.features
    sample = torch.repeat_interleave(torch.arange(len(counts), device=counts.device), counts)
    index = torch.arange(len(sample), device=counts.device) - (counts.cumsum(0) - counts)[sample]
    keys = samples.keys[sample] * RAYS_PER_SAMPLE + index % RAYS_PER_SAMPLE
    tangent, bitangent = tangent_frame(normals)
    frame = torch.stack([tangent, bitangent, normals], dim=1)
    local_view = torch.einsum("nij,nj->ni", frame, view)
    local_view = torch.cat([local_view[:, :2], local_view[:, 2:].clamp(min=1e-3)], dim=-1)
    local_view = local_view / local_view.norm(dim=-1, keepdim=True)

    local_view, frame = local_view[sample], frame[sample]
    alpha, f0 = materials.alpha[sample], materials.f0[sample]
    half = sample_visible_normal(local_view, alpha, random.draw(samples.keys, sample, index))
    view_half = (local_view * half).sum(-1)
    light = 2 * view_half[:, None] * half - local_view
    above = light[:, 2] > 1e-4

    weight = fresnel_schlick(f0, view_half)
    if settings.light_masking:
        shadowing = masking_shadowing_over_masking(local_view[:, 2], light[:, 2], alpha)
        weight = weight * shadowing[:, None]
    if settings.neural > 0:
        part = None if samples.part is None else samples.part[sample]
        g = scene.neural_term(part, features[sample], half, light, alpha)
        weight = weight * (1 + settings.neural * (g - 1))
    weight = weight * above[:, None]
    with torch.no_grad():
        pdf = visible_normal_pdf(local_view[:, 2], half[:, 2], alpha)
        solid_angle = 1 / (counts[sample] * pdf).clamp(min=1e-6)
        if not settings.integral_image:
            solid_angle = torch.zeros_like(solid_angle)
    direction = torch.einsum("nij,ni->nj", frame, light)
    direction = direction / direction.norm(dim=-1, keepdim=True)
    return SecondaryRays(sample, keys, direction, weight, solid_angle, light[:, 2].detach())


def secondary_origins(
    samples: Samples, normals: torch.Tensor, rays: SecondaryRays, reach: torch.Tensor | float
) -> tuple[torch.Tensor, torch.Tensor]:
    """Where secondary rays begin: world points [K, 3] lifted off the surface by `reach`, and the
    distances [K] from which anything can be in their way. No gradient."""
    with torch.no_grad():
        reach = torch.as_tensor(reach, device=normals.device).expand(len(normals))
        origins = (samples.points + reach[:, None] * normals)[rays.sample]
        reach = reach[rays.sample]
        start = torch.minimum(reach * (1 / rays.cosine.clamp(min=0.2) - 1), 4 * reach)
    return origins, start


def choose_noisy_largest(scores: torch.Tensor, budget: int, noise: torch.Tensor) -> torch.Tensor:
    """Indices of the `budget` largest of scores [K], scaled to sum to the budget, plus `noise` [K].

    The paper's choice (§3.4): biased towards what is bright already; the noise varies it.
    """
    if budget <= 0 or len(scores) == 0:
        return torch.zeros(0, dtype=torch.long, device=scores.device)
    scaled = scores * (budget / scores.sum().clamp(min=1e-12)) + noise
    return torch.topk(scaled, min(budget, len(scores)), sorted=False).indices


def choose_systematic(
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
    scene: Scene, tables: StepTables, settings: RenderSettings, random: RandomNumbers,
    samples: Samples, view: torch.Tensor, weights: torch.Tensor, rays: int, trace=None,
) -> Shading:  # fmt: skip
    """Shade samples [S] seen along unit `view` [S, 3] (towards the viewer).

    Args:
        weights: [S] volume rendering weights, which share out the rays.
        rays: secondary rays a pixel.
        trace: traces secondary rays through the field: (origins, directions, keys, start) →
            (radiance [K, 3], transmittance [K]); None at the last bounce.
    """
    surface = scene.surface(samples.points, samples.part, tables.normals)
    normals, materials = surface.normals, surface.materials
    facing = (normals * view).sum(-1, keepdim=True)
    toward = torch.where(facing < 0, -normals, normals)

    diffuse = diffuse_fresnel(materials.f0, facing[:, 0].abs()) * materials.albedo
    radiance = diffuse * irradiance(tables.light, normals) / math.pi

    expected = weights.detach() * rays
    counts = allocate_rays(weights.detach(), rays, random.uniform(ALLOCATION, samples.keys))
    secondary = scatter(surface, toward, view, samples, counts, scene, settings, random)
    if len(secondary.sample) > 0:
        # A sample that was lucky to get its one ray stands for the others like it.
        share = 1 / (expected.clamp(1e-6, 1)[secondary.sample] * counts[secondary.sample])
        throughput = secondary.weight * share[:, None]
        importance = throughput.detach().amax(-1) * weights.detach()[secondary.sample]
        reach = secondary_origins(samples, toward, secondary, surface.reach)
        incident = _incident(scene, tables, settings, random, secondary, importance, *reach, trace)
        radiance = radiance.index_add(0, secondary.sample, throughput * incident)
    return Shading(radiance, normals, surface.features, materials)


def _incident(scene, tables, settings, random, rays, importance, origins, start, trace):
    """Radiance [K, 3] that arrives along secondary rays: the light, and what stands before it.

    With `visibility` every ray is dimmed by the grid, and rays that are blocked are traced; without,
    only traced rays know of the scene, as in the paper.
    """
    light = scene.environment.lookup(tables.light, rays.direction, rays.solid_angle)
    incident = light
    if settings.visibility:
        with torch.no_grad():
            passing = scene.grid_transmittance(origins, rays.direction, start)
        incident = incident * passing[:, None]
        importance = torch.where(passing < 0.95, (1 - passing) * importance, 0.0)
    if trace is None or settings.retraced_rays <= 0:
        return incident
    if settings.retrace_choice == "noisy":
        noise = random.uniform(CHOICE, rays.keys)
        chosen = choose_noisy_largest(importance, settings.retraced_rays, noise)
        probability = torch.ones_like(importance[chosen])
    else:
        # One number for the batch; with a budget for all rays it decides nothing.
        u = float(random.uniform(CHOICE, rays.keys[:1]))
        chosen, probability = choose_systematic(importance, settings.retraced_rays, u)
    if len(chosen) == 0:
        return incident
    bounced, transmittance = trace(
        origins[chosen], rays.direction[chosen], rays.keys[chosen], start[chosen]
    )
    if not settings.visibility:
        bounced = bounced - (1 - transmittance)[:, None] * light[chosen]
    return incident.index_add(0, chosen, bounced / probability[:, None])
