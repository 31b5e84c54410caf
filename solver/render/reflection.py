"""Glossy reflection: rays sampled from the lobe, dimmed by the grid, and some traced once more."""

from __future__ import annotations

from typing import NamedTuple

import torch

from ..brdf.microfacet import (
    fresnel_schlick,
    masking_shadowing_over_masking,
    sample_visible_normal,
    tangent_frame,
    visible_normal_pdf,
)
from ..kernels.backend import fast, on_numba
from ..kernels.specular import specular
from .random_numbers import ALLOCATION, CHOICE, ROTATION, RandomNumbers
from .scene import RenderSettings, Samples, Scene, StepTables, Surface

RAYS_PER_SAMPLE = 1024
"""room for the secondary rays of a sample in a key"""
CLEAR = 0.95
"""transmittance of the grid above which a secondary ray counts as free"""


class Plan(NamedTuple):
    """Which secondary rays are to be sampled: ray k belongs to sample `sample[k]`."""

    counts: torch.Tensor  # [S] long, rays of a sample
    sample: torch.Tensor  # [K] long
    keys: torch.Tensor  # [K] long
    share: torch.Tensor  # [S] by how much a ray counts
    u: torch.Tensor  # [K, 2] uniform in [0, 1)

    def only(self, chosen: torch.Tensor) -> Plan:
        """The rays at indices `chosen`."""
        return Plan(self.counts, self.sample[chosen], self.keys[chosen], self.share, self.u[chosen])


class SecondaryRays(NamedTuple):
    """Secondary rays in flat form; ray k belongs to sample `sample[k]`."""

    sample: torch.Tensor  # [K] long
    keys: torch.Tensor  # [K] long
    direction: torch.Tensor  # [K, 3] world, unit
    weight: torch.Tensor  # [K, 3] BRDF · cosine / density
    solid_angle: torch.Tensor  # [K] 1 / (N · pdf)
    cosine: torch.Tensor  # [K] of the direction to the normal
    spread: torch.Tensor | None = None  # [K, 2, 3] what the pixel adds to the solid angle, rad


def allocate_rays(weights: torch.Tensor, rays: int, u: torch.Tensor) -> torch.Tensor:
    """How many of a pixel's `rays` each sample gets: floor(w·M + u), unbiased for u ~ U[0, 1).

    The paper's floor(w·M) leaves every sample with w < 1/M without any (errata).
    """
    return (weights * rays + u).floor().long()


def plan_rays(
    keys: torch.Tensor, mass: torch.Tensor, rays: int, random: RandomNumbers,
    rotation: int = ROTATION, first_key: int = 0,
) -> Plan:  # fmt: skip
    """Share out a pixel's `rays` among its samples by their mass [S]."""
    expected = mass * rays
    counts = allocate_rays(mass, rays, random.uniform(ALLOCATION, keys))
    sample = torch.repeat_interleave(torch.arange(len(counts), device=counts.device), counts)
    index = torch.arange(len(sample), device=counts.device) - (counts.cumsum(0) - counts)[sample]
    # A sample that was lucky to get its one ray stands for the others like it.
    share = 1 / (expected.clamp(1e-6, 1) * counts.clamp(min=1))
    ray_keys = keys[sample] * RAYS_PER_SAMPLE + (first_key + index) % RAYS_PER_SAMPLE
    return Plan(counts, sample, ray_keys, share, random.draw(keys, sample, index, rotation))


def scatter(
    surface: Surface, normals: torch.Tensor, view: torch.Tensor, part: torch.Tensor | None,
    plan: Plan, scene: Scene, settings: RenderSettings, spread: torch.Tensor | None = None,
) -> SecondaryRays:  # fmt: skip
    """Sample secondary rays at samples with `normals` facing unit `view` [S, 3].

    Args:
        spread: [S, 2, 3] see `footprint.reflected_spread`.
    """
    sample = plan.sample
    tangent, bitangent = tangent_frame(normals)
    frame = torch.stack([tangent, bitangent, normals], dim=1)
    local_view = torch.einsum("nij,nj->ni", frame, view)
    local_view = torch.cat([local_view[:, :2], local_view[:, 2:].clamp(min=1e-3)], dim=-1)
    local_view = local_view / local_view.norm(dim=-1, keepdim=True)

    local_view, frame = local_view[sample], frame[sample]
    alpha, f0 = surface.materials.alpha[sample], surface.materials.f0[sample]
    half = sample_visible_normal(local_view, alpha, plan.u)
    view_half = (local_view * half).sum(-1)
    light = 2 * view_half[:, None] * half - local_view
    above = light[:, 2] > 1e-4

    weight = fresnel_schlick(f0, view_half)
    if settings.light_masking:
        shadowing = masking_shadowing_over_masking(local_view[:, 2], light[:, 2], alpha)
        weight = weight * shadowing[:, None]
    if settings.neural > 0:
        part = None if part is None else part[sample]
        g = scene.neural_term(part, surface.features[sample], half, light, alpha)
        weight = weight * (1 + settings.neural * (g - 1))
    weight = weight * (above * plan.share[sample])[:, None]
    with torch.no_grad():
        pdf = visible_normal_pdf(local_view[:, 2], half[:, 2], alpha)
        solid_angle = 1 / (plan.counts[sample] * pdf).clamp(min=1e-6)
        if not settings.integral_image:
            solid_angle = torch.zeros_like(solid_angle)
    direction = torch.einsum("nij,ni->nj", frame, light)
    direction = direction / direction.norm(dim=-1, keepdim=True)
    spread = None if spread is None or not settings.integral_image else spread[sample]
    return SecondaryRays(
        sample, plan.keys, direction, weight, solid_angle, light[:, 2].detach(), spread
    )


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


def reflected(
    scene: Scene, tables: StepTables, settings: RenderSettings, random: RandomNumbers,
    samples: Samples, surface: Surface, toward: torch.Tensor, view: torch.Tensor,
    mass: torch.Tensor, rays: int, trace=None, spread: torch.Tensor | None = None,
) -> torch.Tensor:  # fmt: skip
    """Radiance [S, 3] that samples reflect glossily along unit `view` [S, 3].

    With `visibility` every ray is dimmed by the grid, and rays that are blocked are traced; without,
    only traced rays know of the scene, as in the paper.

    Args:
        toward: [S, 3] unit normals on the viewer's side. mass: see `shade`.
        rays, trace: see `shade`. spread: [S, 2, 3] see `footprint.reflected_spread`.
    """
    plan = plan_rays(samples.keys, mass, rays, random)
    fused = settings.visibility and settings.neural == 0 and samples.part is None
    if fused and fast(toward) and on_numba(toward.device):
        radiance, (_, weights, passing) = specular(
            toward, surface.materials.alpha, surface.materials.f0, tables.light.table, view,
            samples.points, plan.counts, plan.share, plan.u, scene.environment.row_prefix,
            settings.light_masking, settings.integral_image, scene.blockers(surface.reach), spread,
        )  # fmt: skip
    else:
        secondary = scatter(surface, toward, view, samples.part, plan, scene, settings, spread)
        light = scene.environment.lookup(
            tables.light, secondary.direction, secondary.solid_angle, secondary.spread
        )
        weights, passing = secondary.weight, light.new_ones(len(light))
        if settings.visibility:
            with torch.no_grad():
                origins, start = secondary_origins(samples, toward, secondary, surface.reach)
                passing = scene.grid_transmittance(origins, secondary.direction, start)
        arriving = weights * light * passing[:, None]
        radiance = torch.zeros_like(toward).index_add(0, plan.sample, arriving)
    if trace is None or settings.retraced_rays <= 0 or len(plan.sample) == 0:
        return radiance

    importance = weights.detach().amax(-1) * mass[plan.sample]
    if settings.visibility:
        importance = torch.where(passing < CLEAR, (1 - passing) * importance, 0.0)
    if settings.retrace_choice == "noisy":
        noise = random.uniform(CHOICE, plan.keys)
        chosen = choose_noisy_largest(importance, settings.retraced_rays, noise)
        probability = torch.ones_like(importance[chosen])
    else:
        # One number for the batch; with a budget for all rays it decides nothing.
        u = float(random.uniform(CHOICE, plan.keys[:1]))
        chosen, probability = choose_systematic(importance, settings.retraced_rays, u)
    if len(chosen) == 0:
        return radiance
    again = scatter(surface, toward, view, samples.part, plan.only(chosen), scene, settings, spread)
    origins, start = secondary_origins(samples, toward, again, surface.reach)
    bounced, transmittance = trace(origins, again.direction, again.keys, start)
    if not settings.visibility:
        light = scene.environment.lookup(
            tables.light, again.direction, again.solid_angle, again.spread
        )
        bounced = bounced - (1 - transmittance)[:, None] * light
    return radiance.index_add(0, again.sample, again.weight * bounced / probability[:, None])
