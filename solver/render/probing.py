"""What arrives at a scene's probes: they look around, and see what blocks their light shine."""

import math

import numpy as np
import torch
from torch import Tensor

from ..light.irradiance import Arriving, arriving_harmonics, irradiance, middles, patches
from .mirrors import Looking, look_into_mirrors
from .scene import Scene

BOUNCES = 2
"""how often light is reflected by surfaces, on its way to a probe whose direct view is blocked"""
TURNS = 16
"""of a light that turns, over which its mean is taken"""
PASSING_STEPS = 255
"""of a share that passes: coarse enough to be stored as a byte"""


@torch.no_grad()
def refresh_probes(scene: Scene) -> None:
    """Put probes where the surface is now (a `Scene`'s or `Composition`'s), in the light of the moment.

    Blockers send what they reflect diffusely. Metals mirror; other gloss, and a metal in a metal, counts as
    diffuse.
    """
    nodes, points, part = scene.new_probes()
    cut = patches(points.device)
    light, lobes = _light_of(scene)
    directions = middles(lobes)
    passing, distance = scene.look_around(points, directions)
    passing = (passing * PASSING_STEPS).round() / PASSING_STEPS
    dark = points.new_zeros(len(points), 9, 3)
    scene.probes.fill(nodes, Arriving(passing, lobes, dark))
    if len(points) == 0:
        return
    tables = scene.normal_tables()
    normals, materials = _nearest_surface(scene, tables, points, part, distance, directions)
    blockers = _rows_of_blockers(scene, points, distance, directions)
    looking = Looking(points, part, directions, cut.solid_angle, passing, distance, blockers)
    mirrored = look_into_mirrors(scene, light, looking, materials, tables)
    pairs = mirrored.probe, mirrored.patch
    metals = blockers[pairs]
    diffuse = materials.albedo * (1 - materials.f0)
    sent = dark
    stopped = (1 - passing) * cut.solid_angle
    for _ in range(BOUNCES):
        harmonics = arriving_harmonics(light, Arriving(passing, lobes, sent))
        arriving = irradiance(harmonics, normals) / math.pi
        dull, whole = _rows(diffuse * arriving), _rows((diffuse + materials.f0) * arriving)
        in_metals = dull[metals] + mirrored.light + mirrored.blocked * whole[mirrored.blocker]
        seen = [
            colour[blockers].index_put(pairs, in_metal)
            for colour, in_metal in zip(whole.unbind(1), in_metals.unbind(1), strict=True)
        ]
        sent = torch.stack([(colour * stopped) @ cut.lobes for colour in seen], -1)
    scene.probes.fill(nodes, Arriving(passing, lobes, sent))


def _light_of(scene) -> tuple[Tensor, Tensor]:
    """Prefix sums (`LightTables.table`) of the light that blockers get, and `Patches.lobes` [J, 9]."""
    environment, turntable = scene.environment, scene.turntable
    if turntable is None:
        return environment.tables().table, environment.patch_lobes()
    # It is somewhere else in every photo: the mean over a turn.
    angles = np.linspace(0, 2 * np.pi, TURNS, endpoint=False)
    turns = [torch.from_numpy(turntable.rotation(a)).to(scene.device, torch.float32) for a in angles]
    tables = [environment.tables(turn=turn).table for turn in turns]
    return sum(tables) / len(tables), patches(scene.device).lobes


def _rows(radiance: Tensor) -> Tensor:
    """What is next to probes [P, 3] by `Nodes.row` [1 + P, 3]; far from all of them, their mean."""
    return torch.cat([radiance.mean(0, keepdim=True), radiance])


def _nearest_surface(scene, normal_tables, points, part, distance, directions):
    """Normals [P, 3] and materials of the surface next to each probe."""
    nearest, toward = distance.min(1)
    nearest = torch.where(nearest.isfinite(), nearest, 0.0)
    surface = scene.surface(points + nearest[:, None] * directions[toward], part, normal_tables)
    return surface.normals, surface.materials


def _rows_of_blockers(scene, points, distance, directions) -> Tensor:
    """Rows [P, J] of the probes next to what stands in a probe's way; 0 where nothing does."""
    rows = torch.zeros(distance.shape, dtype=torch.long, device=points.device)
    probe, patch = distance.isfinite().nonzero(as_tuple=True)
    toward = directions[patch]
    hits = points[probe] + distance[probe, patch, None] * toward
    rows[probe, patch] = scene.probe_rows(hits, toward)
    return rows
