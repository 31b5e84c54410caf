"""The room around the object: a plain radiance field of all that lies outside the box.

Photos that show their room see near things before and behind the object, which an environment
without parallax can't be. The room is contracted to a cube so that it has no end: a point p in half
edges of the box, |p|∞ > 1, lies at (2 − 1/|p|∞) p/|p|∞ (Barron et al., "Mip-NeRF 360", 2022,
doi:10.1109/CVPR52688.2022.00539, eq. 10, with the maximum norm as in "MERF", Reiser et al. 2023).
"""

import math

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from ..kernels.skipping import values_at
from ..kernels.vm import vm_products, vm_sum
from .smoothing import upsample

EXTENT = 2.0
"""half edge of the contracted cube"""


def contract(points: Tensor) -> Tensor:
    """Contracted points [N, 3] of points in half edges of the box, from its centre."""
    norm = points.abs().amax(-1, keepdim=True).clamp(min=1.0)
    return points * (2 - 1 / norm) / norm


def expand(contracted: np.ndarray) -> np.ndarray:
    """The inverse of `contract` for points [N, 3] inside the cube, whose faces are infinitely far."""
    norm = np.abs(contracted).max(-1, keepdims=True)
    far = np.maximum(norm, 1.0)
    return contracted / far / np.maximum(2 - far, 1e-6)


class Room(nn.Module):
    """Extinction and radiance of every point outside the box, the same in all directions.

    Args:
        centre: [3] world centre of the box. half_size: half its edge, world units.
        size: grid nodes per axis of the contracted cube.
        allowed: [K, K, K] bool, cells of the contracted cube where there may be something.
        nearest: distance from a ray's origin before which there is nothing, world units.
        extinction: its scale, per unit of contracted length. shift: of the raw density, as in
            `MicrofacetField`.
    """

    def __init__(
        self, centre: Tensor, half_size: float, size: int, allowed: Tensor,
        nearest: float, components: int = 8, feature_components: int = 16,
        extinction: float = 35.0, shift: float = -6.0, initial: float = 0.5,
    ):  # fmt: skip
        super().__init__()
        self.register_buffer("centre", torch.as_tensor(centre, dtype=torch.float32))
        self.register_buffer("allowed", allowed)
        self.half_size, self.nearest = float(half_size), float(nearest)
        self.extinction_scale, self.shift = extinction, shift
        self.planes = nn.Parameter(0.1 * torch.randn(3, size, size, components))
        self.lines = nn.Parameter(0.1 * torch.randn(3, size, components))
        self.colour_planes = nn.Parameter(0.1 * torch.randn(3, size, size, feature_components))
        self.colour_lines = nn.Parameter(0.1 * torch.randn(3, size, feature_components))
        self.basis = nn.Linear(3 * feature_components, 3)
        with torch.no_grad():
            self.basis.bias.fill_(math.log(initial))

    @property
    def size(self) -> int:
        return self.planes.shape[1]

    def parameter_groups(self) -> tuple[list[nn.Parameter], list[nn.Parameter]]:
        """Planes and lines; the network."""
        grids = [self.planes, self.lines, self.colour_planes, self.colour_lines]
        return grids, list(self.basis.parameters())

    def to_unit(self, points: Tensor) -> Tensor:
        """World points [N, 3] in half edges of the box, from its centre."""
        return (points - self.centre) / self.half_size

    def extinction(self, contracted: Tensor) -> Tensor:
        """σ [N] per unit of contracted length at contracted points [N, 3]; 0 where not allowed."""
        raw = vm_sum(self._nodes(contracted), self.planes, self.lines)
        allowed = values_at(self.allowed, 0.5 * (contracted / EXTENT + 1))
        return self.extinction_scale * F.softplus(raw + self.shift) * allowed

    def radiance(self, contracted: Tensor) -> Tensor:
        """Radiance [N, 3], linear Rec.709, at contracted points [N, 3]."""
        products = vm_products(self._nodes(contracted), self.colour_planes, self.colour_lines)
        return self.basis(products).clamp(max=10.0).exp()

    def _nodes(self, contracted: Tensor) -> Tensor:
        return (contracted / EXTENT + 1) * (0.5 * (self.size - 1))

    @torch.no_grad()
    def upsample(self, size: int) -> None:
        for planes, lines in (("planes", "lines"), ("colour_planes", "colour_lines")):
            moved = upsample(getattr(self, planes), getattr(self, lines), size)
            for name, value in zip((planes, lines), moved, strict=True):
                setattr(self, name, nn.Parameter(value))
