"""Diffuse reflection: irradiance by spherical harmonics, put right where something is in the way.

The paper's irradiance knows no occlusion, so shadows end up in the albedo. Here a few cosine-weighted
rays a sample look for blockers; what they find replaces the light that the harmonics had counted:
E = E_SH + π Σ share·[(what the blockers send) − (1 − transmittance)·L]. Where nothing is in the way, the
sum is empty and there is no noise.
"""

from __future__ import annotations

import math

import torch

from ..brdf.microfacet import tangent_frame
from ..kernels.drawing import RAYS_PER_SAMPLE, Plan
from ..light.environment import irradiance
from .random_numbers import DIFFUSE_CHOICE, DIFFUSE_ROTATION, RandomNumbers
from .reflection import (
    CLEAR,
    SecondaryRays,
    choose_systematic,
    plan_rays,
    secondary_origins,
)
from .scene import RenderSettings, Samples, Scene, StepTables, Surface


def diffused(
    scene: Scene, tables: StepTables, settings: RenderSettings, random: RandomNumbers,
    samples: Samples, surface: Surface, reflectance: torch.Tensor, mass: torch.Tensor, trace=None,
) -> torch.Tensor:  # fmt: skip
    """Radiance [S, 3] that samples reflect diffusely.

    Args:
        reflectance: [S, 3] albedo as far as light gets to it.
        mass, trace: see `shade`.
    """
    normals = surface.normals
    radiance = reflectance * irradiance(tables.light, normals) / math.pi
    if settings.diffuse_rays <= 0 or len(normals) == 0:
        return radiance
    # Keys apart from those of glossy rays, which count upwards from zero.
    plan = plan_rays(
        samples.keys, mass, settings.diffuse_rays, random, DIFFUSE_ROTATION, RAYS_PER_SAMPLE // 2
    )
    rays = cosine_rays(normals.detach(), plan)
    origins, start = secondary_origins(samples, normals, rays.sample, rays.direction, surface.reach)
    with torch.no_grad():
        passing = scene.grid_transmittance(origins, rays.direction, start)
    blocked = (passing < CLEAR).nonzero()[:, 0]
    if len(blocked) == 0:
        return radiance
    sample, share = rays.sample[blocked], rays.weight[blocked]
    hidden = scene.environment.lookup(
        tables.light, rays.direction[blocked], rays.solid_angle[blocked]
    ) * (1 - passing[blocked])[:, None]  # fmt: skip
    radiance = radiance.index_add(0, sample, -share * reflectance[sample] * hidden)
    if trace is None or settings.diffuse_retraced_rays <= 0:
        return radiance.clamp(min=0)
    importance = (share * reflectance.detach()[sample]).amax(-1) * mass[sample]
    importance = importance * (1 - passing[blocked])
    u = float(random.uniform(DIFFUSE_CHOICE, rays.keys[:1]))
    chosen, probability = choose_systematic(importance, settings.diffuse_retraced_rays, u)
    which, sample, share = blocked[chosen], sample[chosen], share[chosen]
    bounced, _ = trace(origins[which], rays.direction[which], rays.keys[which], start[which])
    sent = share * reflectance[sample] * bounced / probability[:, None]
    return radiance.clamp(min=0).index_add(0, sample, sent)


def cosine_rays(normals: torch.Tensor, plan: Plan) -> SecondaryRays:
    """Rays distributed as the cosine to their samples' normals [S, 3]; weights are shares."""
    sample = plan.sample
    radius, phi = plan.u[:, 0].sqrt(), 2 * math.pi * plan.u[:, 1]
    height = (1 - plan.u[:, 0]).sqrt().clamp(min=1e-3)
    tangent, bitangent = tangent_frame(normals)
    direction = (
        (radius * torch.cos(phi))[:, None] * tangent[sample]
        + (radius * torch.sin(phi))[:, None] * bitangent[sample]
        + height[:, None] * normals[sample]
    )
    direction = direction / direction.norm(dim=-1, keepdim=True)
    solid_angle = math.pi / (plan.counts[sample] * height)
    return SecondaryRays(sample, plan.keys, direction, plan.share[sample][:, None], solid_angle)
