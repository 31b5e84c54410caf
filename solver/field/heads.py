"""Material heads: albedo, roughness and F0 from the features of a point (paper §3.2)."""

from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from ..kernels.pointwise import at_hand, rowwise

MIN_ALPHA = 0.001


class Materials(NamedTuple):
    """Surface parameters of N points."""

    albedo: Tensor  # [N, 3] linear Rec.709, diffuse reflectance
    alpha: Tensor  # [N] GGX α = roughness²
    f0: Tensor  # [N, 3] linear Rec.709, reflectance at normal incidence


class MaterialHeads(nn.Module):
    """One linear layer a quantity on the features, each through a sigmoid.

    Args:
        features: length of a feature vector.
        albedo, roughness, f0: values at the start (roughness is Blender's r = √α).
    """

    def __init__(self, features: int, albedo: float, roughness: float, f0: float):
        super().__init__()
        self.albedo = self._layer(features, 3, albedo)
        self.roughness = self._layer(features, 1, roughness)
        self.f0 = self._layer(features, 3, f0)

    @staticmethod
    def _layer(features: int, outputs: int, value: float) -> nn.Linear:
        layer = nn.Linear(features, outputs)
        nn.init.xavier_uniform_(layer.weight)
        nn.init.constant_(layer.bias, float(torch.logit(torch.tensor(value))))
        return layer

    def albedo_of(self, features: Tensor) -> Tensor:
        """Albedo [N, 3] alone of features [N, F]."""
        return torch.sigmoid(self.albedo(features))

    def forward(self, features: Tensor) -> Materials:
        """Materials of features [N, F]."""
        # One product for all three layers: a call costs more than its numbers.
        layers = self.albedo, self.f0, self.roughness
        weight = torch.cat([layer.weight for layer in layers])
        bias = torch.cat([layer.bias for layer in layers])
        logits = F.linear(features, weight, bias)
        if at_hand("materials", logits):
            return Materials(*rowwise("materials", (logits,), (MIN_ALPHA,), ((3,), (), (3,))))
        albedo, f0, roughness = torch.sigmoid(logits).split([3, 3, 1], 1)
        roughness = roughness[:, 0]
        return Materials(albedo, (roughness * roughness).clamp(min=MIN_ALPHA), f0)
