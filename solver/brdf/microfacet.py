"""GGX microfacets with Schlick's Fresnel: frames, visible-normal sampling, densities, masking.

All directions point away from the surface. Local frames have the normal along z.
Symbols of the paper: n normal, h half vector, ω_o view (`view`), ω_i light (`light`), α roughness
squared (`alpha`).
"""

import math
from typing import TypeVar

import numpy as np
import torch
from torch import Tensor

Values = TypeVar("Values", Tensor, np.ndarray)

DIELECTRIC_F0 = 0.04
"""reflectance at normal incidence of an index of refraction of 1.5, glTF's and Principled's default"""
SURE_DIELECTRIC_F0 = 0.2
"""below which a surface is surely no metal; diamond, among the highest, has 0.17"""


def tangent_frame(normals: Tensor) -> tuple[Tensor, Tensor]:
    """Tangent and bitangent [N, 3] of unit normals [N, 3], continuous except where n_z changes sign.

    Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017.
    """
    x, y, z = normals.unbind(-1)
    sign = torch.where(z >= 0, 1.0, -1.0).to(normals.dtype)
    a = -1.0 / (sign + z)
    b = x * y * a
    tangent = torch.stack([1 + sign * x * x * a, sign * b, -sign * x], dim=-1)
    bitangent = torch.stack([b, sign + y * y * a, -y], dim=-1)
    return tangent, bitangent


def fresnel_schlick(f0: Tensor, cosine: Tensor) -> Tensor:
    """Reflectance F0 + (1 − F0)(1 − cos)^5 [N, 3] (paper eq. for F; Schlick 1994)."""
    m = (1 - cosine).clamp(0, 1)
    m5 = (m * m) * (m * m) * m
    return f0 + (1 - f0) * m5[..., None]


def principled_albedo(albedo: Values, f0: Values) -> Values:
    """The albedo [..., 3] of Principled's diffuse layer as bright, head-on, as ours beside F0 [..., 3].

    Linear. Its own, base colour · (1 − metalness), gets 1 − 0.04 of the light, ours gets 1 − F0.
    """
    return albedo * (1 - f0) / (1 - DIELECTRIC_F0)


def sample_visible_normal(view: Tensor, alpha: Tensor, u: Tensor) -> Tensor:
    """Half vectors [N, 3] distributed as the GGX normals visible from local `view` [N, 3].

    Heitz, "Sampling the GGX Distribution of Visible Normals", JCGT 7(4), 2018. alpha [N],
    u [N, 2] uniform in [0, 1). Differentiable in view and alpha.
    """
    a = alpha[..., None]
    stretched = torch.cat([a * view[..., :2], view[..., 2:]], dim=-1)
    stretched = stretched / stretched.norm(dim=-1, keepdim=True).clamp(min=1e-12)
    length = (stretched[..., 0] ** 2 + stretched[..., 1] ** 2).clamp(min=1e-14)
    inverse = length.rsqrt()
    on_axis = length <= 1e-12
    t1x = torch.where(on_axis, torch.ones_like(inverse), -stretched[..., 1] * inverse)
    t1y = torch.where(on_axis, torch.zeros_like(inverse), stretched[..., 0] * inverse)
    t1 = torch.stack([t1x, t1y, torch.zeros_like(t1x)], dim=-1)
    t2 = torch.linalg.cross(stretched, t1)
    radius = u[..., 0].sqrt()
    phi = 2 * math.pi * u[..., 1]
    p1 = radius * torch.cos(phi)
    s = 0.5 * (1 + stretched[..., 2])
    p2 = (1 - s) * (1 - p1 * p1).clamp(min=0).sqrt() + s * radius * torch.sin(phi)
    p3 = (1 - p1 * p1 - p2 * p2).clamp(min=1e-12).sqrt()
    half = p1[..., None] * t1 + p2[..., None] * t2 + p3[..., None] * stretched
    half = torch.cat([a * half[..., :2], half[..., 2:].clamp(min=1e-7)], dim=-1)
    return half / half.norm(dim=-1, keepdim=True)


def ggx_distribution(half_z: Tensor, alpha: Tensor) -> Tensor:
    """Isotropic GGX density D(h) of normals with cosine `half_z` [N] (Walter et al. 2007)."""
    a2 = alpha * alpha
    denominator = half_z * half_z * (a2 - 1) + 1
    return a2 / (math.pi * denominator * denominator).clamp(min=1e-20)


def smith_lambda(cosine: Tensor, alpha: Tensor) -> Tensor:
    """Smith's Λ for GGX at a direction with the given |cosine| to the normal [N]."""
    c2 = (cosine * cosine).clamp(1e-8, 1)
    return 0.5 * ((1 + alpha * alpha * (1 - c2) / c2).sqrt() - 1)


def masking(view_z: Tensor, alpha: Tensor) -> Tensor:
    """Smith's G1 [N] of a direction with cosine `view_z`."""
    return 1 / (1 + smith_lambda(view_z, alpha))


def masking_shadowing_over_masking(view_z: Tensor, light_z: Tensor, alpha: Tensor) -> Tensor:
    """G2/G1(view) [N], height correlated: the weight of a visible-normal sample next to F."""
    view_lambda = smith_lambda(view_z, alpha)
    return (1 + view_lambda) / (1 + view_lambda + smith_lambda(light_z, alpha))


def visible_normal_pdf(view_z: Tensor, half_z: Tensor, alpha: Tensor) -> Tensor:
    """Density, per solid angle of the light direction, of sampling through `sample_visible_normal`.

    D(h) G1(view) / (4 cos view): the Jacobian 4 (v·h) of the reflection cancels the v·h of the
    visible-normal density (Heitz 2018, eq. 17).
    """
    return ggx_distribution(half_z, alpha) * masking(view_z, alpha) / (4 * view_z.abs().clamp(min=1e-4))
