"""Several fitted scenes as one, under one light, traced together (paper Fig. 'environment swap', b)."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from ..capture.camera import Camera
from ..field.heads import Materials
from ..light.environment import EnvironmentMap
from ..light.irradiance import irradiance
from .probes import Probes, nodes_of
from .scene import Scene, Steps, Surface


@dataclass(frozen=True)
class Placement:
    """A similarity: world = scale · Rz(turn) · local + position.

    Attributes:
        position: world units. scale: > 0. turn: radians about +Z.
    """

    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    scale: float = 1.0
    turn: float = 0.0

    def rotation(self, device) -> Tensor:
        """[3, 3], local to world."""
        c, s = torch.cos(torch.tensor(self.turn)), torch.sin(torch.tensor(self.turn))
        zero, one = torch.zeros(()), torch.ones(())
        rows = [torch.stack([c, -s, zero]), torch.stack([s, c, zero]), torch.stack([zero, zero, one])]
        return torch.stack(rows).to(device)

    def to_world(self, points: Tensor) -> Tensor:
        """World points of local ones, [N, 3] each."""
        rotation = self.rotation(points.device)
        return self.scale * (points @ rotation.T) + points.new_tensor(self.position)

    def to_local(self, points: Tensor, directions: Tensor) -> tuple[Tensor, Tensor]:
        """Local points and directions of those in the world, [N, 3] each; lengths stay as they are."""
        rotation = self.rotation(points.device)
        moved = (points - points.new_tensor(self.position)) @ rotation / self.scale
        return moved.contiguous(), (directions @ rotation).contiguous()


class Composition(nn.Module):
    """Scenes placed in one world, with what a renderer asks of a `Scene`, which describes it.

    Media are superposed: every part is sampled with its own step, and the samples of all parts are
    sorted along each ray, so parts may interpenetrate. Secondary rays see all parts. The rooms they
    were photographed in stay behind, and so do the origins of far captures.
    """

    room = turntable = None
    origin = np.zeros(3)

    def __init__(self, parts: list[Scene], placements: list[Placement], environment: EnvironmentMap):
        super().__init__()
        self.parts = nn.ModuleList(parts)
        self.placements = placements
        self.environment = environment
        self.probes = Probes()

    @property
    def _placed(self) -> Iterator[tuple[Scene, Placement]]:
        return zip(self.parts, self.placements, strict=True)

    @property
    def device(self) -> torch.device:
        return self.parts[0].device

    def turn_for(self, camera: Camera) -> None:
        """The common light stands still."""
        return None

    def normal_tables(self) -> list:
        return [part.normal_tables() for part in self.parts]

    def sample(self, origins, directions, start, offset, step_voxels, min_transmittance) -> Steps:
        found = []
        for part, placement in self._placed:
            steps = part.sample(
                *placement.to_local(origins, directions), start / placement.scale, offset,
                step_voxels, min_transmittance,
            )  # fmt: skip
            found.append((steps.ray, steps.distance * placement.scale, steps.depth))
        ray, distance, depth = (torch.cat(values) for values in zip(*found, strict=True))
        part = torch.cat([torch.full_like(values[0], index) for index, values in enumerate(found)])
        order = torch.argsort(distance, stable=True)
        order = order[torch.argsort(ray[order], stable=True)]
        ray, distance, depth, part = ray[order], distance[order], depth[order], part[order]
        counts = torch.bincount(ray, minlength=len(origins))
        offsets = torch.cat([counts.new_zeros(1), counts.cumsum(0)])
        return Steps(depth, distance, ray, offsets, part)

    def surface(self, points, part, normal_tables) -> Surface:
        """`part` [S] says which part each point belongs to."""
        size = max(scene.field.basis.out_features for scene in self.parts)
        normals = torch.zeros_like(points)
        features = points.new_zeros(len(points), size)
        albedo, f0 = torch.zeros_like(points), torch.zeros_like(points)
        alpha, reach = points.new_ones(len(points)), points.new_zeros(len(points))
        for index, scene, placement, mine, local in self._by_part(points, part):
            found = scene.surface(local, None, normal_tables[index])
            turned = found.normals @ placement.rotation(points.device).T
            normals = normals.index_copy(0, mine, turned)
            padded = torch.nn.functional.pad(found.features, (0, size - found.features.shape[1]))
            features = features.index_copy(0, mine, padded)
            albedo = albedo.index_copy(0, mine, found.materials.albedo)
            alpha = alpha.index_copy(0, mine, found.materials.alpha)
            f0 = f0.index_copy(0, mine, found.materials.f0)
            reach[mine] = found.reach * placement.scale
        return Surface(normals, features, Materials(albedo, alpha, f0), reach)

    def _by_part(self, points, part) -> Iterator[tuple[int, Scene, Placement, Tensor, Tensor]]:
        """Each part with its number, its placement, which points are its own, and these in its world."""
        for index, (scene, placement) in enumerate(self._placed):
            mine = (part == index).nonzero()[:, 0]
            yield index, scene, placement, mine, placement.to_local(points[mine], points[mine])[0]

    def surface_normals(self, points, part, normal_tables) -> Tensor:
        normals = torch.zeros_like(points)
        for index, scene, placement, mine, local in self._by_part(points, part):
            found = scene.surface_normals(local, None, normal_tables[index])
            normals[mine] = found @ placement.rotation(points.device).T
        return normals

    def neural_term(self, part, features, half, light, alpha) -> Tensor:
        """Every part has its own g, or the shared one."""
        g = torch.ones_like(half)
        for index, scene in enumerate(self.parts):
            mine = (part == index).nonzero()[:, 0]
            own = features[mine][:, : scene.field.basis.out_features]
            values = scene.neural(own, half[mine], light[mine], alpha[mine])
            g = g.index_copy(0, mine, values)
        return g

    def grid_transmittance(self, origins, directions, start) -> Tensor:
        passing = torch.ones_like(start)
        for scene, placement in self._placed:
            local = placement.to_local(origins, directions)
            passing = passing * scene.grid_transmittance(*local, start / placement.scale)
        return passing

    def irradiance(self, points, part, normals, light) -> Tensor:
        if self.probes.arriving is None:
            return irradiance(light.irradiance[0], normals)
        arriving = torch.zeros_like(points)
        for index, (scene, placement) in enumerate(self._placed):
            mine = (part == index).nonzero()[:, 0]
            local = placement.to_local(points[mine], normals[mine])
            lifted = scene.before_surface(*local, self.probes.nodes[index].spacing)
            found = self.probes.irradiance(light.irradiance, index, lifted, normals[mine])
            arriving = arriving.index_copy(0, mine, found)
        return arriving

    @property
    def cell(self) -> float:
        """Edge of the largest occupancy cell, world units."""
        return max(scene.cell * placement.scale for scene, placement in self._placed)

    def new_probes(self):
        nodes, points, part = [], [], []
        for index, (scene, placement) in enumerate(self._placed):
            first_row = 1 + sum(len(some) for some in points)
            grid, local = nodes_of(scene.occupancy.optical_depth(), first_row)
            nodes.append(grid)
            points.append(placement.to_world(scene.field.from_box(local)))
            part.append(torch.full((len(local),), index, device=local.device))
        return nodes, torch.cat(points), torch.cat(part)

    def probe_rows(self, hits, directions) -> Tensor:
        rows = torch.zeros(len(hits), dtype=torch.long, device=hits.device)
        for index, (scene, placement) in enumerate(self._placed):
            local = placement.to_local(hits, directions)
            found = self.probes.nearest_rows(index, scene.before_hit(*local))
            rows = torch.where(rows > 0, rows, found)
        return rows

    def look_around(self, points, directions):
        passing = points.new_ones(len(points), len(directions))
        distance = torch.full_like(passing, torch.inf)
        for scene, placement in self._placed:
            seen, where = scene.look_around(*placement.to_local(points, directions))
            passing = passing * seen
            distance = torch.minimum(distance, where * placement.scale)
        return passing, distance
