"""Diffuse reflection: irradiance by spherical harmonics, put right where something is in the way.

The paper's irradiance knows no occlusion, so shadows end up in the albedo. Here a few cosine-weighted
rays a sample look for blockers; what they find replaces the light that the harmonics had counted:
E = E_SH + π/N Σ [(what the blockers send) − (1 − transmittance)·L]. Where nothing is in the way, the
sum is empty and there is no noise.
"""

from __future__ import annotations

import math

import torch

from ..brdf.microfacet import tangent_frame
from ..light.environment import irradiance
from .random_numbers import DIFFUSE_CHOICE, DIFFUSE_ROTATION, RandomNumbers
from .reflection import CLEAR, RAYS_PER_SAMPLE, SecondaryRays, choose_systematic, secondary_origins
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
    rays = cosine_rays(samples, normals.detach(), settings.diffuse_rays, random)
    origins, start = secondary_origins(samples, normals, rays, surface.reach)
    with torch.no_grad():
        passing = scene.grid_transmittance(origins, rays.direction, start)
    blocked = (passing < CLEAR).nonzero()[:, 0]
    if len(blocked) == 0:
        return radiance
    sample, share = rays.sample[blocked], 1 / settings.diffuse_rays
    hidden = scene.environment.lookup(
        tables.light, rays.direction[blocked], rays.solid_angle[blocked]
    ) * (1 - passing[blocked])[:, None]  # fmt: skip
    radiance = radiance.index_add(0, sample, -share * reflectance[sample] * hidden)
    if trace is None or settings.diffuse_retraced_rays <= 0:
        return radiance.clamp(min=0)
    importance = reflectance.detach().amax(-1)[sample] * mass[sample] * (1 - passing[blocked])
    u = float(random.uniform(DIFFUSE_CHOICE, rays.keys[:1]))
    chosen, probability = choose_systematic(importance, settings.diffuse_retraced_rays, u)
    which, sample = blocked[chosen], sample[chosen]
    bounced, _ = trace(origins[which], rays.direction[which], rays.keys[which], start[which])
    sent = share * reflectance[sample] * bounced / probability[:, None]
    return radiance.clamp(min=0).index_add(0, sample, sent)


def cosine_rays(
    samples: Samples, normals: torch.Tensor, count: int, random: RandomNumbers
) -> SecondaryRays:
    """`count` rays a sample, distributed as the cosine to its normal [S, 3]; no gradient."""
    device = normals.device
    sample = torch.arange(len(normals), device=device).repeat_interleave(count)
    index = torch.arange(count, device=device).repeat(len(normals))
    u = random.draw(samples.keys, sample, index, DIFFUSE_ROTATION)
    radius, phi = u[:, 0].sqrt(), 2 * math.pi * u[:, 1]
    height = (1 - u[:, 0]).sqrt().clamp(min=1e-3)
    tangent, bitangent = tangent_frame(normals)
    direction = (
        (radius * torch.cos(phi))[:, None] * tangent[sample]
        + (radius * torch.sin(phi))[:, None] * bitangent[sample]
        + height[:, None] * normals[sample]
    )
    direction = direction / direction.norm(dim=-1, keepdim=True)
    # Keys apart from those of glossy rays, which count upwards from zero.
    keys = samples.keys[sample] * RAYS_PER_SAMPLE + RAYS_PER_SAMPLE // 2 + index
    return SecondaryRays(sample, keys, direction, direction, math.pi / (count * height), height)
