"""Glossy reflection: rays sampled from the lobe, dimmed by the grid, and some traced once more."""

from typing import NamedTuple

import torch
from torch import Tensor

from ..brdf.microfacet import (
    fresnel_schlick,
    masking_shadowing_over_masking,
    sample_visible_normal,
    tangent_frame,
    visible_normal_pdf,
)
from ..field.heads import Materials
from ..kernels import drawing
from ..kernels.backend import fast, fast_on_numba, precise
from ..kernels.drawing import LEAST_SCORE, Plan
from ..kernels.flat_form import has_no_order, indices_of, nothing_follows
from ..kernels.pointwise import at_hand, rowwise
from ..kernels.skipping import SELF_SHADOW_COSINE
from ..kernels.specular import Near, specular
from ..light.floor import Floor
from .random_numbers import ALLOCATION, CHOICE, ROTATION, RandomNumbers
from .scene import RenderSettings, Samples, Scene, StepTables, Surface

CLEAR = 0.95
"""transmittance of the grid above which a secondary ray counts as free"""
FARTHEST_START = 4.0
"""of a ray along its surface, in units of its origin's height"""


class SecondaryRays(NamedTuple):
    """Secondary rays in flat form; ray k belongs to sample `sample[k]`."""

    sample: Tensor  # [K] long
    keys: Tensor  # [K] long
    direction: Tensor  # [K, 3] world, unit
    weight: Tensor  # [K, 3] BRDF · cosine / density
    solid_angle: Tensor  # [K] 1 / (N · pdf)
    spread: Tensor | None = None  # [K, 2, 3] what the pixel adds to the solid angle, rad


def plan_rays(keys: Tensor, mass: Tensor, rays: int, random: RandomNumbers) -> Plan:
    """Share out a primary ray's `rays` among the samples along it by mass [S] (`drawing.plan_rays`)."""
    streams = random.stream(ALLOCATION), random.stream(ROTATION)
    return drawing.plan_rays(keys, mass, rays, random.points, streams)


def scatter(
    surface: Surface, normals: Tensor, view: Tensor, part: Tensor | None,
    plan: Plan, scene: Scene, settings: RenderSettings, spread: Tensor | None = None,
) -> SecondaryRays:  # fmt: skip
    """Sample secondary rays at samples with `normals` facing unit `view` [S, 3].

    Args:
        spread: [S, 2, 3] see `footprint.reflected_spread`.
    """
    sample = plan.sample
    leave = _leave_at_once if at_hand("scattered", normals) else _leave
    half, light, direction, weight, solid_angle = leave(surface.materials, normals, view, plan, settings)
    if settings.neural > 0:
        part = None if part is None else part[sample]
        alpha = surface.materials.alpha.detach()[sample]
        features = surface.features.index_select(0, sample)
        g = scene.neural_term(part, features, half, light, alpha)
        weight = weight * (1 + settings.neural * (g - 1))
    spread = None if spread is None or not settings.integral_image else spread[sample]
    return SecondaryRays(sample, plan.keys, direction, weight, solid_angle, spread)


def _leave(
    materials: Materials, normals: Tensor, view: Tensor, plan: Plan, settings: RenderSettings
) -> tuple[Tensor, ...]:
    """Rays [K] as they leave: local half vectors and directions, world directions, weights without g, and
    solid angles."""
    sample = plan.sample
    tangent, bitangent = tangent_frame(normals)
    frame = torch.stack([tangent, bitangent, normals], dim=1)
    local_view = torch.einsum("nij,nj->ni", frame, view)
    local_view = torch.cat([local_view[:, :2], local_view[:, 2:].clamp(min=1e-3)], dim=-1)
    local_view = local_view / local_view.norm(dim=-1, keepdim=True)

    local_view, frame = local_view[sample], frame[sample]
    alpha, f0 = materials.alpha[sample], materials.f0[sample]
    half = sample_visible_normal(local_view, alpha, plan.u)
    view_half = (local_view * half).sum(-1)
    light = 2 * view_half[:, None] * half - local_view
    above = light[:, 2] > 1e-4

    weight = fresnel_schlick(f0, view_half)
    if settings.light_masking:
        shadowing = masking_shadowing_over_masking(local_view[:, 2], light[:, 2], alpha)
        weight = weight * shadowing[:, None]
    weight = weight * (above * plan.share[sample])[:, None]
    with torch.no_grad():
        pdf = visible_normal_pdf(local_view[:, 2], half[:, 2], alpha)
        solid_angle = 1 / (plan.together[sample] * pdf).clamp(min=1e-6)
        if not settings.integral_image:
            solid_angle = torch.zeros_like(solid_angle)
    solid_angle = _widening(solid_angle, alpha, settings)
    direction = torch.einsum("nij,ni->nj", frame, light)
    return half, light, direction / direction.norm(dim=-1, keepdim=True), weight, solid_angle


def _leave_at_once(
    materials: Materials, normals: Tensor, view: Tensor, plan: Plan, settings: RenderSettings
) -> tuple[Tensor, ...]:
    """`_leave` in one kernel."""
    *rays, solid_angle = rowwise(
        "scattered",
        (normals, materials.alpha, materials.f0, view, plan.share, plan.together, plan.sample, plan.u),
        (settings.light_masking, settings.integral_image), ((3,), (3,), (3,), (3,), ()),
        len(plan.sample),
    )  # fmt: skip
    alpha = materials.alpha[plan.sample]
    return *rays, _widening(solid_angle.detach(), alpha, settings)


def _widening(solid_angle: Tensor, alpha: Tensor, settings: RenderSettings) -> Tensor:
    """Solid angles [K] with the gradient to α [K] that they have in narrow lobes, where they go with α²."""
    if not (settings.widening_gradient and settings.integral_image and alpha.requires_grad):
        return solid_angle
    return solid_angle * (alpha / alpha.detach()).square()


@torch.no_grad()
def secondary_origins(
    samples: Samples, normals: Tensor, sample: Tensor, direction: Tensor, reach: Tensor | float
) -> tuple[Tensor, Tensor]:
    """Where secondary rays begin: world points [K, 3] lifted off the surface by `reach`, and the
    distances [K] from which anything can be in their way. No gradient.

    Args:
        normals: [S, 3]. sample: [K] long, where each ray leaves from. direction: [K, 3] unit.
    """
    if not isinstance(reach, Tensor):
        reach = normals.new_full((len(normals),), reach)
    if at_hand("lifted", normals):
        inputs = normals, samples.points, reach, sample, direction
        return rowwise("lifted", inputs, (SELF_SHADOW_COSINE, FARTHEST_START), ((3,), ()), len(sample))
    normal, reach = normals[sample], reach[sample]
    origins = samples.points[sample] + reach[:, None] * normal
    cosine = (normal * direction).sum(-1).clamp(min=SELF_SHADOW_COSINE)
    return origins, reach * (1 / cosine - 1).clamp(max=FARTHEST_START)


def choose_noisy_largest(scores: Tensor, budget: int, noise: Tensor) -> Tensor:
    """Indices of the `budget` largest of scores [K], scaled to sum to the budget, plus `noise` [K].

    The paper's choice (§3.4): biased towards what is bright already; the noise varies it.
    """
    if budget <= 0 or len(scores) == 0:
        return torch.zeros(0, dtype=torch.long, device=scores.device)
    scaled = scores * (budget / scores.sum().clamp(min=1e-12)) + noise
    return torch.topk(scaled, min(budget, len(scores)), sorted=False).indices


def choose_systematic(scores: Tensor, budget: int, u: Tensor | float) -> tuple[Tensor, Tensor]:
    """Systematic sampling of about `budget` rays by score: indices and their probabilities.

    Dividing what a chosen ray brings by its probability keeps the estimate unbiased.
    """
    candidates, total = scores > 0, scores.sum().clamp(min=LEAST_SCORE)
    if scores.device.type == "cpu" and has_no_order():
        few = candidates.nonzero()[:, 0]
        if len(few) <= budget:
            return few, torch.ones_like(scores[few])
    shared = (scores * (budget / total)).clamp(max=1)
    probability = torch.where(candidates.sum() <= budget, candidates.to(scores), shared)
    running = (probability.to(precise(scores.device)).cumsum(0) + u).floor()
    chosen = torch.diff(running, prepend=running.new_zeros(1)) > 0
    indices, real = indices_of(chosen)
    found = probability[indices]
    return indices, found if real is None else torch.where(real, found, 1.0)


def reflected(
    scene: Scene, tables: StepTables, settings: RenderSettings, random: RandomNumbers,
    samples: Samples, surface: Surface, toward: Tensor, view: Tensor,
    mass: Tensor, rays: int, trace=None, spread: Tensor | None = None,
) -> Tensor:  # fmt: skip
    """Radiance [S, 3] that samples reflect glossily along unit `view` [S, 3].

    With `visibility` every ray is dimmed by the grid, and rays that are blocked are traced; without,
    only traced rays know of the scene, as in the paper.

    Args:
        toward: [S, 3] unit normals on the viewer's side. mass: see `shade`.
        rays, trace: see `shade`. spread: [S, 2, 3] see `footprint.reflected_spread`.
    """
    plan = plan_rays(samples.keys, mass, rays, random)
    sample = plan.sample
    fused = settings.visibility and settings.neural == 0 and samples.part is None
    if fused and fast(toward):
        radiance, (direction, weight, passing) = specular(
            toward, surface.materials.alpha, surface.materials.f0, tables.light.table, view,
            samples.points, plan.offsets, plan.share, plan.together, plan.u, scene.environment.row_prefix,
            settings.light_masking, settings.integral_image, settings.widening_gradient,
            scene.blockers(surface.reach), spread, _near(scene.environment.floor, samples.points),
        )  # fmt: skip
    else:
        secondary = scatter(surface, toward, view, samples.part, plan, scene, settings, spread)
        direction, weight = secondary.direction, secondary.weight
        at = None if scene.environment.floor is None else samples.points[sample]
        light = scene.environment.lookup(
            tables.light, direction, secondary.solid_angle, secondary.spread, at
        )
        passing = light.new_ones(len(light))
        if settings.visibility:
            with torch.no_grad():
                lifted = secondary_origins(samples, toward, sample, direction, surface.reach)
                passing = scene.grid_transmittance(lifted[0], direction, lifted[1])
        arriving = weight * light * passing[:, None]
        radiance = torch.zeros_like(toward).index_add(0, sample, arriving)
    if trace is None or settings.retraced_rays <= 0 or nothing_follows(sample):
        return radiance

    chosen, probability = _choose(settings, random, plan, weight.detach(), passing, mass)
    if nothing_follows(chosen):
        return radiance
    sample = sample[chosen]
    direction, weight = direction.index_select(0, chosen), weight.index_select(0, chosen)
    origins, start = secondary_origins(samples, toward, sample, direction, surface.reach)
    bounced, transmittance = trace(origins, direction, plan.keys[chosen], start)
    if not settings.visibility:
        bounced = bounced - (1 - transmittance)[:, None] * light.index_select(0, chosen)
    return radiance.index_add(0, sample, weight * bounced / probability[:, None])


def _choose(
    settings: RenderSettings, random: RandomNumbers, plan: Plan, weight: Tensor,
    passing: Tensor, mass: Tensor,
) -> tuple[Tensor, Tensor]:  # fmt: skip
    """Which secondary rays are traced once more, and the probabilities with which these were chosen."""
    sample, budget = plan.sample, settings.retraced_rays
    systematic = settings.retrace_choice != "noisy"
    # One number for the batch; with a budget for all rays it decides nothing.
    u = random.uniform(CHOICE, plan.keys[:1] if systematic else plan.keys)
    if settings.visibility and systematic and fast_on_numba(weight):
        return drawing.choose_blocked(weight, passing, mass, sample, CLEAR, budget, u)
    importance = weight.amax(-1) * mass[sample]
    if settings.visibility:
        importance = torch.where(passing < CLEAR, (1 - passing) * importance, 0.0)
    if systematic:
        return choose_systematic(importance, budget, u)
    noise = torch.where(mass[sample] > 0, u, -1.0)
    chosen = choose_noisy_largest(importance, budget, noise)
    return chosen, torch.ones_like(importance[chosen])


def _near(floor: Floor | None, points: Tensor) -> Near | None:
    """What of the light comes from close by to points [S, 3]."""
    return None if floor is None else Near(floor.shifts(points), floor.up)
