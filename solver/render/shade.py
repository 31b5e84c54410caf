"""Radiance leaving shaded points: diffuse by SH irradiance, glossy by secondary rays."""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from ..field.heads import Materials
from ..kernels.pointwise import at_hand, rowwise
from .footprint import reflected_spread
from .random_numbers import RandomNumbers
from .reflection import reflected
from .scene import RenderSettings, Samples, Scene, StepTables


class Shading(NamedTuple):
    """Shaded samples: radiance [S, 3] and what it was made of."""

    radiance: Tensor  # [S, 3] linear Rec.709
    normals: Tensor  # [S, 3] world, unit, outward
    features: Tensor  # [S, F]
    materials: Materials


def diffuse_fresnel(f0: Tensor, cosine: Tensor) -> Tensor:
    """Share (1 − F) of the light that reaches the diffuse layer [N, 3], averaged over light directions.

    (1 − F0)(1 − s(n·v)) with s the hemispherical mean of (1 − v·h)^5, fitted; within 0.2 % of the
    integral, and what the Cycles material of the asset does.
    """
    s = 0.0271 * (1 - cosine).clamp(0, 1) ** 2.65 + 0.0005
    return (1 - f0) * (1 - s)[:, None]


def diffuse_radiance(
    normals: Tensor, materials: Materials, light: Tensor, view: Tensor
) -> tuple[Tensor, Tensor]:
    """Radiance [S, 3] that samples scatter of irradiance `light` [S, 3] along unit `view` [S, 3], and their
    normals on the viewer's side."""
    if at_hand("diffuse", normals):
        inputs = normals, materials.f0, materials.albedo, light, view
        return rowwise("diffuse", inputs, (), ((3,), (3,)))
    facing = (normals * view).sum(-1, keepdim=True)
    toward = torch.where(facing < 0, -normals, normals)
    reflectance = diffuse_fresnel(materials.f0, facing[:, 0].abs()) * materials.albedo
    return reflectance * light / math.pi, toward


def shade(
    scene: Scene, tables: StepTables, settings: RenderSettings, random: RandomNumbers,
    samples: Samples, view: Tensor, mass: Tensor, rays: int, trace=None,
    pixel_angle: Tensor | None = None,
) -> Shading:  # fmt: skip
    """Shade samples [S] seen along unit `view` [S, 3] (towards the viewer).

    Args:
        mass: [S] by how much of its primary ray each sample stands for, which shares out the rays.
        rays: secondary rays a primary ray.
        trace: traces secondary rays through the field: (origins, directions, keys, start) →
            (radiance [K, 3], transmittance [K]); None at the last bounce.
        pixel_angle: [R] angular width of each ray's pixel, rad; None: rays have no width.
    """
    if settings.emission >= 1:
        return _glow(scene, tables, samples)
    surface = scene.surface(samples.points, samples.part, tables.normals)
    normals, materials = surface.normals, surface.materials
    light = scene.irradiance(samples.points, samples.part, normals, tables.light)
    diffuse, toward = diffuse_radiance(normals, materials, light, view)
    spread = None
    if pixel_angle is not None and settings.pixel_footprint:
        spread = reflected_spread(scene, tables, samples, normals, view, pixel_angle)
    glossy = reflected(
        scene, tables, settings, random, samples, surface, toward, view, mass, rays, trace, spread
    )
    radiance = diffuse + glossy
    if settings.emission > 0:
        radiance = torch.lerp(radiance, materials.albedo, settings.emission)
    return Shading(radiance, normals, surface.features, materials)


def _glow(scene: Scene, tables: StepTables, samples: Samples) -> Shading:
    """Samples that shine by themselves: nothing but their colour has a gradient, so the rest is left
    out of fits (zero), and only pictures have it."""
    if not torch.is_grad_enabled():
        surface = scene.surface(samples.points, samples.part, tables.normals)
        return Shading(surface.materials.albedo, *surface[:3])
    features = scene.field.features(scene.field.to_box(samples.points))
    albedo = scene.field.heads.albedo_of(features)
    nothing = torch.zeros_like(albedo)
    materials = Materials(albedo, nothing[:, 0], nothing)
    return Shading(albedo, nothing, features, materials)
