"""The far-field environment light: radiance exp(x) on an equirectangular map (paper §3.3, App. A).

Directions and texels follow Blender's equirectangular convention as `capture.frames` has it:
u = ½ − atan2(y, x)/2π, v = acos(z)/π; column = u·W, row = v·H, row 0 at +Z.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from ..capture.frames import texel_directions
from ..kernels.backend import precise
from ..kernels.integral import prefix_sums, rectangle_mean
from ..kernels.sphere import look_up
from .floor import Floor, SeenFromCentre
from .irradiance import COSINE_LOBE, Arriving, arriving_harmonics, bright_lobes
from .spherical_harmonics import sh_basis


class LightTables(NamedTuple):
    """What the lookups of one optimisation step share, built once a step."""

    table: Tensor  # [H+1, W+1, 3] double: prefix sums of radiance × solid angle
    irradiance: Tensor  # [1 + R, 9, 3]: SH coefficients, of all light and of `Arriving`


def equirect_coordinates(directions: Tensor, height: int, width: int) -> Tensor:
    """Continuous (column, row) [..., 2] in texels of unit directions [..., 3], differentiable."""
    x, y, z = directions.unbind(-1)
    # atan2 has no gradient on the polar axis: move such directions off it by far less than a texel.
    x = torch.where((x.abs() < 1e-7) & (y.abs() < 1e-7), torch.full_like(x, 1e-7), x)
    u = 0.5 - torch.atan2(y, x) / (2 * math.pi)
    v = torch.acos(z.clamp(-1 + 1e-7, 1 - 1e-7)) / math.pi
    return torch.stack([u * width, v * height], dim=-1)


def equirect_directions(height: int, width: int, device=None) -> Tensor:
    """Unit directions [H, W, 3] double of the texel centres."""
    return torch.from_numpy(texel_directions(height, width)).to(device)


def texel_solid_angles(height: int) -> Tensor:
    """Solid angle [H] double of a texel of every row of a map that is twice as wide as high, sr."""
    edges = torch.cos(torch.arange(height + 1, dtype=torch.float64) * math.pi / height)
    return (edges[:-1] - edges[1:]) * (math.pi / height)


def resized_map(values: Tensor, height: int) -> Tensor:
    """A map [3, H, 2H] on the sphere at another height, bilinear."""
    row, column = (
        (torch.arange(count, device=values.device) + 0.5) / count * size
        for count, size in ((height, values.shape[1]), (2 * height, values.shape[2]))
    )
    return look_up(values, torch.stack(torch.meshgrid(column, row, indexing="xy"), dim=-1))


def coarsely_coloured(radiance: Tensor, texels: int) -> Tensor:
    """Radiance [3, H, 2H] whose brightness, the mean of its channels, stays, and whose colour is that of
    the energy of squares of `texels`, blended between their centres.

    Args:
        texels: has to divide H.
    """
    energy = radiance * texel_solid_angles(radiance.shape[1]).to(radiance)[:, None]
    squares = F.avg_pool2d(energy, texels)
    colour = resized_map(squares / squares.mean(0, keepdim=True), radiance.shape[1])
    return radiance.mean(0, keepdim=True) * colour


class _MapConstants(NamedTuple):
    """What depends on a map's size alone."""

    texel_solid_angle: Tensor  # [H]
    row_prefix: Tensor  # [H + 1]
    irradiance_weights: Tensor  # [9, H·W] float


@lru_cache(maxsize=16)
def _map_constants(height: int, device: torch.device) -> _MapConstants:
    width = 2 * height
    texel = texel_solid_angles(height)
    rows = torch.cat([torch.zeros(1, dtype=torch.float64), texel.cumsum(0)])
    basis = sh_basis(equirect_directions(height, width), 2)
    lobe = torch.tensor(COSINE_LOBE, dtype=torch.float64)
    weights = (basis * texel[:, None, None] * lobe).reshape(-1, 9).T.float().contiguous()
    sums = precise(device)
    return _MapConstants(texel.to(device, sums), rows.to(device, sums), weights.to(device))


@lru_cache(maxsize=128)
def _places_before(height: int, turn: tuple[float, ...], device: torch.device) -> Tensor:
    """Where (columns, rows) [H, W, 2] the light of each texel was before a turn [9]; a fit of a turntable
    asks again and again for those of its photos."""
    directions = equirect_directions(height, 2 * height)
    # A row vector times the rotation: turnᵀ · d.
    before = directions @ torch.tensor(turn, dtype=torch.float64).view(3, 3)
    return equirect_coordinates(before, height, 2 * height).float().to(device)


class _Exponential(torch.autograd.Function):
    """exp(min(x, most)). What is above that has a gradient, too, so that it may come down; and the adjoint
    is one product, where torch's looks at the map three times more."""

    @staticmethod
    def forward(ctx, logarithm, most):
        value = logarithm.clamp(max=most).exp_()
        ctx.save_for_backward(value)
        return value

    @staticmethod
    def backward(ctx, cotangent):
        (value,) = ctx.saved_tensors
        return cotangent * value, None


class EnvironmentMap(nn.Module):
    """An environment map with trainable log-radiance.

    Args:
        height: rows; the map is twice as wide.
        initial: radiance of every texel at the start, linear Rec.709.
        floor: what of the light comes from close by; None: all is far away.
    """

    MAX_LOG_RADIANCE = 20.0

    def __init__(self, height: int, initial: float = 0.5, floor: Floor | None = None):
        super().__init__()
        self.floor = floor
        self.log_radiance = nn.Parameter(torch.full((3, height, 2 * height), math.log(initial)))

    @property
    def texel_solid_angle(self) -> Tensor:
        """Solid angle of a texel of every row [H], sr."""
        return self._constants.texel_solid_angle

    @property
    def row_prefix(self) -> Tensor:
        """Prefix sums of a texel's solid angle down the rows [H + 1]."""
        return self._constants.row_prefix

    @property
    def _constants(self) -> _MapConstants:
        return _map_constants(self.height, self.log_radiance.device)

    @classmethod
    def from_radiance(cls, radiance: Tensor) -> "EnvironmentMap":
        """A map that holds given radiance [H, 2H, 3], linear Rec.709, Blender's equirect.

        Zeros become 1e-6, since the parameter is a logarithm.
        """
        height, width = radiance.shape[:2]
        if width != 2 * height:
            raise ValueError(
                f"an environment map must be twice as wide as high, this one is {width}×{height}"
            )
        environment = cls(height)
        with torch.no_grad():
            environment.log_radiance.copy_(radiance.permute(2, 0, 1).float().clamp(1e-6).log())
        return environment

    @property
    def height(self) -> int:
        return self.log_radiance.shape[1]

    @property
    def width(self) -> int:
        return self.log_radiance.shape[2]

    def radiance(self, turn: Tensor | None = None) -> Tensor:
        """Radiance [3, H, W], linear Rec.709.

        Args:
            turn: [3, 3] rotation by which the light is turned: what came from d comes from turn · d.
        """
        radiance = _Exponential.apply(self.log_radiance, self.MAX_LOG_RADIANCE)
        if turn is None:
            return radiance
        places = _places_before(self.height, tuple(turn.flatten().tolist()), radiance.device)
        return look_up(radiance, places.to(radiance.dtype))

    def image(self) -> np.ndarray:
        """Radiance [H, W, 3] float32, linear Rec.709, Blender's equirect convention."""
        radiance = self.radiance().detach().permute(1, 2, 0)
        return np.ascontiguousarray(radiance.cpu().numpy(), dtype=np.float32)

    def tables(self, arriving: Arriving | None = None, turn: Tensor | None = None) -> LightTables:
        """Summed-area table and irradiance of the current map; rebuild after every step.

        Args:
            arriving: what of it gets to the points whose irradiance is wanted too.
            turn: see `radiance`.
        """
        radiance = self.radiance(turn)
        table = prefix_sums(radiance, self.texel_solid_angle)
        weights = self._constants.irradiance_weights
        irradiance = F.linear(radiance.reshape(3, -1), weights).T[None]
        if arriving is not None:
            irradiance = torch.cat([irradiance, arriving_harmonics(table, arriving)])
        return LightTables(table, irradiance)

    def patch_lobes(self) -> Tensor:
        """`Patches.lobes` [J, 9] where this light is in each patch; no gradient."""
        radiance = self.radiance().detach()
        harmonics = self._constants.irradiance_weights
        return bright_lobes(harmonics, radiance.mean(0).flatten())

    def lookup(
        self, tables: LightTables, directions: Tensor, solid_angle: Tensor,
        spread: Tensor | None = None, points: Tensor | None = None,
    ) -> Tensor:  # fmt: skip
        """Mean radiance [N, 3] over a square of `solid_angle` [N] sr around directions [N, 3].

        The square is one of latitude and longitude: height √(area·sinθ), width √(area/sinθ) in
        texels (paper Appendix A with the rectangle's size put right: a sample stands for the solid
        angle 1/(N·p)). It is never smaller than a texel, so a lookup is at least bilinear.

        Args:
            solid_angle: gradients flow to it as well, where it is above 0.
            spread: [N, 2, 3] edges of a parallelogram of directions, rad, over which the square is
                blurred: the rectangle gets the variance of both along either axis. No gradient.
            points: [N, 3] where the light arrives, which matters for what of it is close by; None: far
                from all.
        """
        seen = None
        if self.floor is not None and points is not None:
            seen = self.floor.seen(self.floor.shifts(points), directions)
            directions = seen.directions
        centre = equirect_coordinates(directions, self.height, self.width)
        variance = self._variance(directions, solid_angle, spread, seen)
        size = self.footprint(centre[:, 1].detach(), variance)
        return rectangle_mean(tables.table, self.row_prefix, centre, size)

    def footprint(self, row: Tensor, variance: Tensor) -> Tensor:
        """(columns, rows) [N, 2] of rectangles at continuous rows [N].

        Args:
            variance: [N, 2] their squared widths, rad², along longitude and latitude.
        """
        sine = torch.sin(row * (math.pi / self.height)).clamp(min=1e-4)
        side = variance.sqrt()
        rows = side[:, 1] * (self.height / math.pi)
        columns = side[:, 0] / sine * (self.width / (2 * math.pi))
        return torch.stack(
            [columns.clamp(1.0, float(self.width)), rows.clamp(1.0, 0.5 * self.height)], dim=-1
        )

    @staticmethod
    def _variance(
        directions: Tensor, solid_angle: Tensor, spread: Tensor | None, seen: SeenFromCentre | None
    ) -> Tensor:
        """Squared widths [N, 2], rad², along longitude and latitude, of squares of solid angles [N]
        around directions [N, 3], blurred by parallelograms [N, 2, 3]; both as rays see them. Gradients
        flow to the solid angles alone."""
        square = solid_angle.clamp(0, 4 * math.pi)[:, None].expand(-1, 2)
        if seen is None and spread is None:
            return square
        with torch.no_grad():
            x, y, z = directions.unbind(-1)
            sine = (x * x + y * y).sqrt().clamp(min=1e-4)
            east = torch.stack([-y / sine, x / sine, torch.zeros_like(z)], dim=-1)
            south = torch.stack([x * z / sine, y * z / sine, -sine], dim=-1)
            axes = torch.stack([east, south], dim=1)
            if seen is not None:
                axes = seen.along_rays(axes)
            stretched = axes.square().sum(-1)
            blurred = 0.0
            if spread is not None:
                blurred = torch.einsum("nij,nkj->nki", spread, axes).square().sum(-1)
        return (square if seen is None else square * stretched) + blurred

    def resized(self, height: int) -> "EnvironmentMap":
        """The same light on a map of another height (coarse to fine), bilinear in its logarithm."""
        log_radiance = resized_map(self.log_radiance.detach(), height)
        other = EnvironmentMap(height, floor=self.floor)
        with torch.no_grad():
            other.log_radiance.copy_(log_radiance)
        return other.to(self.log_radiance.device)
