"""What probes see in metals around them: light that is mirrored onto what stands beside (caustics).

Taken for diffuse, a metal would send what it gets to all sides alike, and the lamps that it throws onto a
table would stay in the table's albedo. So where a probe looks at metal, it sees the mean of the light over
what its patch of directions becomes in that mirror, however bent. See docs/decisions/0047.
"""

from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor

from ..brdf.microfacet import fresnel_schlick, tangent_frame
from ..field.heads import Materials
from ..light.environment import LightTables
from ..light.irradiance import patches_at
from .footprint import turned_mirrored

MIRROR_F0 = 0.2
"""of the brightest channel, from which a surface is a mirror"""
LEAST_COSINE, LEAST_SLOPE = 0.05, 0.2
"""between surface and view: at the first a ray grazes, below the second a patch is no longer"""
BEND_CELLS = 2.0
"""cells over which the bend of a surface is measured at most: further on its tangent leaves it"""
MOST_SPREAD = 2.0
"""rad, edge of what a patch becomes"""


class Mirrored(NamedTuple):
    """What K pairs of probes and patches of directions see in metals."""

    probe: Tensor  # [K] long
    patch: Tensor  # [K] long, in which the probe looks
    light: Tensor  # [K, 3] mirrored radiance that comes from far away
    blocked: Tensor  # [K, 3] share of what the blocker on the way sends
    blocker: Tensor  # [K] long: its row, as in `Nodes.row`


class Looking(NamedTuple):
    """How P probes see J patches of directions."""

    points: Tensor  # [P, 3] world
    part: Tensor | None  # [P] long
    directions: Tensor  # [J, 3] world, unit
    solid_angle: Tensor  # [J] sr
    passing: Tensor  # [P, J]
    distance: Tensor  # [P, J] of what stands in the way, or infinite
    blockers: Tensor  # [P, J] long: its row


def look_into_mirrors(
    scene, light: Tensor, looking: Looking, materials: Materials, normal_tables
) -> Mirrored:
    """What probes see in the metals around them.

    Args:
        scene: a `Scene` or a `Composition`. light: prefix sums (`LightTables.table`).
        materials: of the surfaces next to the probes. normal_tables: see `Scene.normal_tables`.
    """
    mirrors = F.pad(materials.f0.amax(-1) > MIRROR_F0, (1, 0))
    probe, patch = mirrors[looking.blockers].nonzero(as_tuple=True)
    beside = looking.blockers[probe, patch] - 1
    toward, distance = looking.directions[patch], looking.distance[probe, patch]
    hits = looking.points[probe] + distance[:, None] * toward
    part = None if looking.part is None else looking.part[beside]
    edge = looking.solid_angle[patch].sqrt()
    mirrored, cosine, spread = _mirror(scene, normal_tables, hits, part, toward, distance, edge)
    # Of a lobe's peak: 1 / pdf, for its rays lie a quarter as dense as normals do.
    lobe = 4 * torch.pi * materials.alpha[beside].square()
    lobe = lobe.clamp(max=4 * torch.pi)
    environment = scene.environment
    radiance = environment.lookup(LightTables(light, None), mirrored, lobe, spread, hits)
    share = fresnel_schlick(materials.f0[beside], cosine)
    back = patches_at(mirrored)
    passing = looking.passing[beside, back][:, None]
    return Mirrored(
        probe, patch, share * passing * radiance, share * (1 - passing), looking.blockers[beside, back]
    )


def _mirror(scene, normal_tables, hits, part, toward, distance, edge):
    """Mirrored directions [K, 3], their cosines [K], and the edges [K, 2, 3] of what patches become; see
    `footprint.reflected_spread`, whose pixels are small."""
    normals, view = scene.surface_normals(hits, part, normal_tables), -toward
    cosine = (normals * view).sum(-1)
    facing = cosine.clamp(min=LEAST_COSINE)[:, None]
    mirrored = F.normalize(toward + 2 * facing * normals, dim=-1)
    reach = (edge * distance)[:, None]
    measured = reach.clamp(max=BEND_CELLS * scene.cell)
    edges = []
    for side in tangent_frame(view):
        slid = (side * normals).sum(-1, keepdim=True) / facing.clamp(min=LEAST_SLOPE)
        beside = hits + measured * (side - slid * view)
        bend = scene.surface_normals(beside, part, normal_tables) - normals
        bend = bend * (reach / measured)
        edges.append(turned_mirrored(edge[:, None] * side, bend, normals, view, facing))
    spread = torch.stack(edges, 1)
    length = spread.norm(dim=-1, keepdim=True)
    return mirrored, cosine, spread * (MOST_SPREAD / length.clamp(min=MOST_SPREAD))
