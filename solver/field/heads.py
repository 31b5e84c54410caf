"""Material heads: albedo, roughness and F0 from the features of a point (paper §3.2)."""

from __future__ import annotations

from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import nn

from ..brdf.microfacet import DIELECTRIC_F0

MIN_ALPHA = 0.001


class Materials(NamedTuple):
    """Surface parameters of N points."""

    albedo: torch.Tensor  # [N, 3] linear Rec.709, diffuse reflectance
    alpha: torch.Tensor  # [N] GGX α = roughness²
    f0: torch.Tensor  # [N, 3] linear Rec.709, reflectance at normal incidence
    metalness: torch.Tensor | None = None  # [N] where the heads know of metals


class MaterialHeads(nn.Module):
    """One linear layer a quantity on the features, each through a sigmoid; albedo and F0 on their own,
    as in the paper.

    Args:
        features: length of a feature vector.
        albedo, roughness, f0: values at the start (roughness is Blender's r = √α).
    """

    def __init__(self, features: int, albedo: float, roughness: float, f0: float):
        super().__init__()
        self.albedo = _layer(features, 3, albedo)
        self.roughness = _layer(features, 1, roughness)
        self.f0 = _layer(features, 3, f0)

    def albedo_of(self, features: torch.Tensor) -> torch.Tensor:
        """Albedo [N, 3] alone of features [N, F]."""
        return torch.sigmoid(self.albedo(features))

    def forward(self, features: torch.Tensor) -> Materials:
        """Materials of features [N, F]."""
        albedo, f0, roughness = _values(features, self.albedo, self.f0, self.roughness)
        return Materials(albedo, _alpha(roughness), f0)


class MetallicHeads(nn.Module):
    """Base colour b and metalness m instead, as in Principled: albedo b (1 − m), F0 0.04 (1 − m) + b m.

    What is no metal has a known F0, and what is one has no albedo (docs/decisions/0015).

    Args:
        features: length of a feature vector.
        base_colour, roughness, metalness: values at the start.
    """

    def __init__(self, features: int, base_colour: float, roughness: float, metalness: float):
        super().__init__()
        self.base_colour = _layer(features, 3, base_colour)
        self.roughness = _layer(features, 1, roughness)
        self.metalness = _layer(features, 1, metalness)

    def albedo_of(self, features: torch.Tensor) -> torch.Tensor:
        """Albedo [N, 3] alone of features [N, F]."""
        base, metalness = _values(features, self.base_colour, self.metalness)
        return base * (1 - metalness)

    def forward(self, features: torch.Tensor) -> Materials:
        """Materials of features [N, F]."""
        base, metal, roughness = _values(features, self.base_colour, self.metalness, self.roughness)
        albedo, f0 = base * (1 - metal), DIELECTRIC_F0 * (1 - metal) + base * metal
        return Materials(albedo, _alpha(roughness), f0, metal[:, 0])


def _layer(features: int, outputs: int, value: float) -> nn.Linear:
    layer = nn.Linear(features, outputs)
    nn.init.xavier_uniform_(layer.weight)
    nn.init.constant_(layer.bias, float(torch.logit(torch.tensor(value))))
    return layer


def _values(features: torch.Tensor, *layers: nn.Linear) -> tuple[torch.Tensor, ...]:
    """What layers say of features [N, F], each [N, its outputs] in (0, 1)."""
    # One product for all layers: a call costs more than its numbers.
    weight = torch.cat([layer.weight for layer in layers])
    bias = torch.cat([layer.bias for layer in layers])
    values = torch.sigmoid(F.linear(features, weight, bias))
    return values.split([layer.out_features for layer in layers], 1)


def _alpha(roughness: torch.Tensor) -> torch.Tensor:
    return (roughness * roughness)[:, 0].clamp(min=MIN_ALPHA)
