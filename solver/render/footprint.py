"""How far a mirror spreads a pixel: what its reflection covers of the light, from the normals' bend.

A pixel is a small square, not a ray. A curved mirror widens it: on a ball that fills a hundred
pixels, each of them reflects several degrees of the environment. One ray through the pixel's centre
cannot match a photo that averages over all that, however exact the surface is (docs/decisions/0011).
Igehy, "Tracing Ray Differentials", SIGGRAPH 1999.
"""

import torch
from torch import Tensor

from ..brdf.microfacet import tangent_frame
from ..kernels.pointwise import at_hand, rowwise
from .scene import Samples, Scene, StepTables

LEAST_COSINE = 0.1
"""between surface and viewer, for how far a pixel reaches along the surface"""


@torch.no_grad()
def reflected_spread(
    scene: Scene, tables: StepTables, samples: Samples, normals: Tensor, view: Tensor, pixel_angle: Tensor
) -> Tensor:
    """By how much mirrored directions differ across a pixel [S, 2, 3], rad, one row for each of the
    pixel's two edges; world. No gradient.

    Args:
        normals, view: [S, 3] world, unit; the sign of a normal does not matter.
        pixel_angle: [R] angular width of each ray's pixel, rad.
    """
    angle = pixel_angle[samples.ray][:, None]
    if at_hand("pixel_edges", normals):
        return _spread_at_once(scene, tables, samples, normals, view, angle[:, 0])
    facing = (normals * view).sum(-1, keepdim=True)
    sign = torch.where(facing < 0, -1.0, 1.0)
    slope = facing.abs().clamp(min=LEAST_COSINE) * sign
    edges = torch.stack(tangent_frame(view))
    # The pixel's edges, slid along the view onto the surface's tangent plane.
    along = edges - (edges * normals).sum(-1, keepdim=True) / slope * view
    points = samples.points + angle * samples.distance[:, None] * along
    part = None if samples.part is None else samples.part.repeat(2)
    other = scene.surface_normals(points.view(-1, 3), part, tables.normals).view_as(points)
    bend = other - normals
    return turned_mirrored(angle * edges, bend, normals, view, facing).transpose(0, 1)


def turned_mirrored(turn: Tensor, bend: Tensor, normals: Tensor, view: Tensor, facing: Tensor) -> Tensor:
    """By how much mirrored directions [..., 3] differ where views are turned and normals are bent [..., 3].

    Args:
        normals, view: [..., 3] unit. facing: [..., 1] their cosine.
    """
    # Of r = d − 2 (d·n) n with d = −view: dr = dd − 2 (dd·n + d·dn) n − 2 (d·n) dn.
    change = (turn * normals - view * bend).sum(-1, keepdim=True)
    return turn - 2 * change * normals + 2 * facing * bend


def _spread_at_once(
    scene: Scene, tables: StepTables, samples: Samples, normals: Tensor, view: Tensor, angle: Tensor
) -> Tensor:
    """`reflected_spread` in two kernels, before and after normals are looked up; `angle` [S]."""
    edges = normals, view, samples.points, samples.distance, angle
    (points,) = rowwise("pixel_edges", edges, (LEAST_COSINE,), ((2, 3),))
    part = None if samples.part is None else samples.part.repeat_interleave(2)
    other = scene.surface_normals(points.view(-1, 3), part, tables.normals).view_as(points)
    return rowwise("mirrored_edges", (normals, view, other, angle), (), ((2, 3),))[0]
