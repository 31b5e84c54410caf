"""The microfacet field: VM density and features in a cubic box, normals and materials from them."""

import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from ..kernels.pointwise import at_hand, rowwise
from ..kernels.vm import vm_gradient, vm_products, vm_sum
from ..kernels.vm_torch import vm_interpolation_gradient
from .heads import MaterialHeads, Materials
from .smoothing import gaussian_taps, smoothed_factors, upsample

LEAST_SLOPE = 1e-5
"""of raw densities per grid unit, below which a normal is no unit vector"""


class MicrofacetField(nn.Module):
    """Density, normals and materials of every point of a cube.

    World points [N, 3] are mapped to box units [0, 1]^3 by `to_box`. Raw density s is the sum of
    the VM products; extinction σ = `density_scale` · softplus(s + `density_shift`) per world unit
    (TensoRF's activation; nmf public code, ×25 and −4).

    Args:
        centre: [3] world centre of the box. half_size: half its edge, world units.
        size: grid nodes per axis.
        axes: [3, 3] unit rows, the box's axes in the world, where it is turned; None: the world's.
        smoothed_normals: normals from the Gaussian-smoothed finite difference (paper §3.1), not
            from the derivative of the interpolation.

    `smoothing` is the standard deviation of that Gaussian as a share of the box's edge; where it is
    narrower than the paper's kernel, as at the start, the paper's is taken. `steepness` is how many times
    as steep as at first `steepen` has made it.
    """

    def __init__(
        self, centre: Tensor, half_size: float, size: int, density_components: int = 16,
        feature_components: int = 24, feature_size: int = 24, density_shift: float = -4.0,
        density_scale: float = 25.0, initial_albedo: float = 0.5, initial_roughness: float = 0.4,
        initial_f0: float = 0.1, smoothed_normals: bool = True, axes: Tensor | None = None,
    ):  # fmt: skip
        super().__init__()
        self.register_buffer("centre", torch.as_tensor(centre, dtype=torch.float32))
        axes = None if axes is None else torch.as_tensor(axes, dtype=torch.float32)
        self.register_buffer("axes", axes, persistent=False)
        self.half_size = float(half_size)
        self.density_shift, self.density_scale = density_shift, density_scale
        self.smoothed_normals = smoothed_normals
        self.smoothing = 0.0
        self.steepness = 1.0
        self.density_planes = _factor(3, size, size, density_components)
        self.density_lines = _factor(3, size, density_components)
        self.feature_planes = _factor(3, size, size, feature_components)
        self.feature_lines = _factor(3, size, feature_components)
        self.basis = nn.Linear(3 * feature_components, feature_size, bias=False)
        self.heads = MaterialHeads(feature_size, initial_albedo, initial_roughness, initial_f0)

    @property
    def size(self) -> int:
        """Grid nodes per axis."""
        return self.density_planes.shape[1]

    @property
    def voxel(self) -> float:
        """Edge of a voxel in world units."""
        return 2 * self.half_size / (self.size - 1)

    def to_box(self, points: Tensor) -> Tensor:
        """World points [N, 3] in box units."""
        return self.to_axes(points - self.centre) / (2 * self.half_size) + 0.5

    def from_box(self, box_points: Tensor) -> Tensor:
        """World points [N, 3] of box units, the inverse of `to_box`."""
        return self.centre + self.from_axes((2 * box_points - 1) * self.half_size)

    def directions_to_box(self, directions: Tensor) -> Tensor:
        """World directions [N, 3] per world unit of length, in box units."""
        return self.to_axes(directions) / (2 * self.half_size)

    def to_axes(self, directions: Tensor) -> Tensor:
        """World directions [N, 3] along the box's axes."""
        return directions if self.axes is None else directions @ self.axes.T

    def from_axes(self, directions: Tensor) -> Tensor:
        """World directions [N, 3] of those along the box's axes, the inverse of `to_axes`."""
        return directions if self.axes is None else directions @ self.axes

    def raw_density(self, box_points: Tensor, known: Tensor | None = None) -> Tensor:
        """Raw density s [N] at box points [N, 3]; gradients to the factors.

        Args:
            known: its values [N], where they were computed before.
        """
        nodes = self.size - 1
        return vm_sum(box_points * nodes, self.density_planes, self.density_lines, known)

    @torch.no_grad()
    def steepen(self, factor: float, extinction: float) -> None:
        """Make the raw density `factor` times as steep about where σ is `extinction` per world unit.

        That stays where it is, and normals as they are; what is denser becomes denser, all else emptier.
        """
        self.density_planes *= math.sqrt(factor)
        self.density_lines *= math.sqrt(factor)
        self.density_shift += (1 - factor) * self.raw_of(extinction)
        self.steepness *= factor

    @torch.no_grad()
    def raw_density_grid(self, count: int) -> Tensor:
        """Raw density [K, K, K] at `count` nodes per axis, from face to face of the box."""
        planes, lines = upsample(self.density_planes, self.density_lines, count)
        total = planes[0] @ lines[0].T
        total += (planes[1] @ lines[1].T).transpose(1, 2)
        total += (planes[2] @ lines[2].T).permute(2, 0, 1)
        return total

    def extinction(self, raw: Tensor) -> Tensor:
        """σ [N] per world unit of raw densities [N]."""
        return self.density_scale * F.softplus(raw + self.density_shift)

    def raw_of(self, extinction: float) -> float:
        """The raw density that has an extinction above 0 per world unit, the inverse of `extinction`."""
        share = extinction / self.density_scale
        return share + math.log(-math.expm1(-share)) - self.density_shift

    def normal_factors(self) -> tuple[Tensor, Tensor]:
        """Factors of the gradient; build once a step and hand to `normals`."""
        if not self.smoothed_normals:
            return self.density_planes, self.density_lines
        taps = gaussian_taps(self.smoothing * (self.size - 1))
        return smoothed_factors(self.density_planes, self.density_lines, taps)

    def normals(self, box_points: Tensor, factors: tuple[Tensor, Tensor]) -> Tensor:
        """Unit outward normals [N, 3], world: minus the (smoothed) gradient of the raw density."""
        gradient_of = vm_gradient if self.smoothed_normals else vm_interpolation_gradient
        gradient = gradient_of(box_points * (self.size - 1), *factors)
        if at_hand("outward", gradient):
            outward = rowwise("outward", (gradient,), (LEAST_SLOPE,), ((3,),))[0]
        else:
            outward = -F.normalize(gradient, dim=-1, eps=LEAST_SLOPE)
        return self.from_axes(outward)

    def features(self, box_points: Tensor) -> Tensor:
        """Feature vectors [N, F] at box points [N, 3]."""
        nodes = self.size - 1
        return self.basis(vm_products(box_points * nodes, self.feature_planes, self.feature_lines))

    def materials(self, features: Tensor) -> Materials:
        """Materials of feature vectors [N, F]."""
        return self.heads(features)

    @torch.no_grad()
    def upsample(self, size: int) -> None:
        """Move all factors to a grid of `size` nodes per axis."""
        for name in ("density", "feature"):
            planes, lines = getattr(self, f"{name}_planes"), getattr(self, f"{name}_lines")
            planes, lines = upsample(planes, lines, size)
            setattr(self, f"{name}_planes", nn.Parameter(planes))
            setattr(self, f"{name}_lines", nn.Parameter(lines))


def _factor(*shape: int) -> nn.Parameter:
    return nn.Parameter(0.1 * torch.randn(*shape))
