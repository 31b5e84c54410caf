"""What arrives at a scene's probes: they look around, and see what blocks their light shine."""

from __future__ import annotations

import math

import numpy as np
import torch

from ..light.irradiance import Arriving, arriving_harmonics, irradiance, middles, patches
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

    Blockers send what they reflect diffusely, and their gloss as if it were diffuse.
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
    normals, reflectance = _nearest_surface(scene, points, part, distance, directions)
    blockers = _rows_of_blockers(scene, points, distance, directions)
    sent = dark
    stopped = (1 - passing) * cut.solid_angle
    for _ in range(BOUNCES):
        harmonics = arriving_harmonics(light, Arriving(passing, lobes, sent))
        radiance = reflectance * irradiance(harmonics, normals) / math.pi
        radiance = torch.cat([radiance.mean(0, keepdim=True), radiance])
        sent = torch.stack(
            [(colour[blockers] * stopped) @ cut.lobes for colour in radiance.unbind(1)], -1
        )
    scene.probes.fill(nodes, Arriving(passing, lobes, sent))


def _light_of(scene) -> tuple[torch.Tensor, torch.Tensor]:
    """Prefix sums (`LightTables.table`) of the light that blockers get, and `Patches.lobes` [J, 9]."""
    environment, turntable = scene.environment, scene.turntable
    if turntable is None:
        return environment.tables().table, environment.patch_lobes()
    # It is somewhere else in every photo: the mean over a turn.
    angles = np.linspace(0, 2 * np.pi, TURNS, endpoint=False)
    turns = [
        torch.from_numpy(turntable.rotation(a)).to(scene.device, torch.float32) for a in angles
    ]
    tables = [environment.tables(turn=turn).table for turn in turns]
    return sum(tables) / len(tables), patches(scene.device).lobes


def _nearest_surface(scene, points, part, distance, directions):
    """Normals and reflectances [P, 3] of the surface next to each probe."""
    nearest, toward = distance.min(1)
    nearest = torch.where(nearest.isfinite(), nearest, 0.0)
    surface = scene.surface(
        points + nearest[:, None] * directions[toward], part, scene.normal_tables()
    )
    albedo, f0 = surface.materials.albedo, surface.materials.f0
    return surface.normals, albedo * (1 - f0) + f0


def _rows_of_blockers(scene, points, distance, directions) -> torch.Tensor:
    """Rows [P, J] of the probes next to what stands in a probe's way; 0 where nothing does."""
    rows = torch.zeros(distance.shape, dtype=torch.long, device=points.device)
    probe, patch = distance.isfinite().nonzero(as_tuple=True)
    toward = directions[patch]
    hits = points[probe] + distance[probe, patch, None] * toward
    rows[probe, patch] = scene.probe_rows(hits, toward)
    return rows
