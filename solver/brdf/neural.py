"""The neural term g of the BRDF (paper §3.2, Appendix B): what Schlick × GGX cannot express."""

import torch
from torch import Tensor, nn

from ..kernels.pointwise import at_hand, rowwise
from ..light.spherical_harmonics import sh_basis, sh_degrees


class NeuralTerm(nn.Module):
    """g(features, half vector, light direction; α) in (0, 1)^3, an MLP on attenuated SH.

    The directions are local, without gradient, encoded by spherical harmonics of degree ≤ 4, each
    degree attenuated by exp(−l(l+1)/2·α) as if blurred by the lobe (Ref-NeRF's integrated
    encoding, doi:10.1109/CVPR52688.2022.00541).

    Args:
        features: length of a feature vector.
        width: hidden units; two hidden layers.
        initial: value of g at the start.
    """

    DEGREE = 4

    def __init__(self, features: int, width: int = 64, initial: float = 0.9):
        super().__init__()
        inputs = features + 2 * ((self.DEGREE + 1) ** 2 + 3)
        self.layers = nn.Sequential(
            nn.Linear(inputs, width), nn.ReLU(), nn.Linear(width, width), nn.ReLU(), nn.Linear(width, 3)
        )
        for layer in self.layers:
            if isinstance(layer, nn.Linear):
                nn.init.kaiming_uniform_(layer.weight, nonlinearity="relu")
                nn.init.zeros_(layer.bias)
        with torch.no_grad():
            self.layers[-1].weight.mul_(0.1)
            self.layers[-1].bias.fill_(torch.logit(torch.tensor(initial)))
        self.register_buffer("degrees", sh_degrees(self.DEGREE), persistent=False)

    def forward(self, features: Tensor, half: Tensor, light: Tensor, alpha: Tensor) -> Tensor:
        """features [N, F], local unit half and light [N, 3], alpha [N] → g [N, 3]."""
        half, light, alpha = half.detach(), light.detach(), alpha.detach()
        if at_hand("directions_encoded", half):
            encoded = rowwise("directions_encoded", (half, light, alpha), (), ((56,),))[0]
            return torch.sigmoid(self.layers(torch.cat([features, encoded], dim=-1)))
        attenuation = torch.exp(-0.5 * self.degrees * (self.degrees + 1) * alpha[:, None])
        encoded = torch.cat(
            [
                features,
                sh_basis(half, self.DEGREE) * attenuation,
                half,
                sh_basis(light, self.DEGREE) * attenuation,
                light,
            ],
            dim=-1,
        )
        return torch.sigmoid(self.layers(encoded))
