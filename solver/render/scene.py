"""All that is optimised, and what a renderer asks of it; the settings of a render."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from ..brdf.neural import NeuralTerm
from ..capture.camera import Camera
from ..capture.turntable import Turntable
from ..field.field import MicrofacetField
from ..field.heads import Materials
from ..field.occupancy import Occupancy
from ..field.room import Room
from ..kernels.march import grid_transmittance, march
from ..kernels.specular import Blockers
from ..kernels.visibility import look_around
from ..light.environment import EnvironmentMap, LightTables
from ..light.irradiance import irradiance
from .nested import mapped, tensors_of
from .probes import LIFT_NODES, Nodes, Probes, nodes_of


@dataclass(frozen=True)
class RenderSettings:
    """How accurately rays are traced. Distances are in voxels of the field's grid."""

    step: float = 0.5
    """distance of density samples along a primary ray, voxels"""
    secondary_step: float = 1.0
    """the same along retraced secondary rays"""
    pixel_grid: int = 1
    """primary rays through a pixel: so many across and so many down"""
    secondary_rays: int = 16
    """M: secondary rays a pixel, shared among its samples by weight"""
    min_weight: float = 0.01
    """samples that weigh less than this are not shaded; the others make up for them"""
    shaded_depths: int = 0
    """density samples of a primary ray that are shaded, chosen at random by weight (0: all)"""
    secondary_depths: int = 0
    """the same of a retraced ray"""
    min_transmittance: float = 1e-3
    """a ray ends where less than this passes"""
    retraced_rays: int = 512
    """R: secondary rays of a batch that are traced through the field once more (0: single bounce)"""
    retrace_choice: str = "systematic"
    """how the R are chosen: 'systematic', by importance and unbiased, or 'noisy', the paper's R
    largest after adding noise"""
    secondary_bounce_rays: int = 2
    """secondary rays at the end of a retraced ray"""
    diffuse_visibility: bool = True
    """diffuse light is what gets to a surface, and what blockers send; else all there is, the paper's"""
    neural: float = 1.0
    """1: the BRDF has the full neural term g; 0: g = 1; between: g blended towards 1"""
    emission: float = 0.0
    """share of its own colour that a point sends as if it shone: 1 is a plain radiance field"""
    visibility: bool = True
    """all secondary rays see the environment through the occupancy grid's extinction"""
    pixel_footprint: bool = True
    """the environment is also averaged over what the pixel covers of it, widened by the surface's bend"""
    integral_image: bool = True
    """the environment is averaged over what a secondary ray stands for; else a point lookup"""
    widening_gradient: bool = True
    """gradients of roughness know that rays of a wider lobe stand for more of the environment; in a fit,
    `fit.unbiased` says"""
    neighbour_distance: float = 0.0
    """standard deviation, voxels, of the points close by that smoothness terms look at; 0: none"""
    light_masking: bool = True
    """weight G2/G1 of a visible-normal sample is applied (the paper leaves it to g)"""


class Steps(NamedTuple):
    """Density samples of R rays in flat form; those of ray r are `offsets[r]:offsets[r + 1]`."""

    depth: Tensor  # [S] optical depth
    distance: Tensor  # [S] along the ray, world units
    ray: Tensor  # [S] long
    offsets: Tensor  # [R + 1] long
    part: Tensor | None = None  # [S] long: which part of a composition


class Samples(NamedTuple):
    """The steps that are shaded, and where they are."""

    points: Tensor  # [S, 3] world
    distance: Tensor  # [S] along the ray, world units
    ray: Tensor  # [S] long
    keys: Tensor  # [S] long, for random numbers
    part: Tensor | None = None  # [S] long: which part of a composition


class Surface(NamedTuple):
    """What the field says of S points."""

    normals: Tensor  # [S, 3] world, unit, outward
    features: Tensor  # [S, F]
    materials: Materials
    reach: Tensor | float  # [S] world units: height from which secondary rays can be blocked


FRINGE_CELLS = 1.5
"""cells around a probe that block nothing: it may stand in the surface's fringe"""
SELF_SHADOW_VOXELS = 2.0
"""height above its origin from which a secondary ray can be blocked, in voxels of the coarser grid"""


class Scene(nn.Module):
    """Field, light and neural term, with the occupancy grid that follows the field.

    `room`, where photos show one, is what else they see: it is fitted and looked at, but neither
    lights the object (the environment does) nor becomes an asset. `origin` [3] (double) is where in the
    capture's world the scene's coordinates are counted from. `turntable`: the object was turned for its
    photos (scene coordinates), and the environment is as its `zero` has it.
    """

    def __init__(
        self, field: MicrofacetField, environment: EnvironmentMap, neural: NeuralTerm, cells: int,
        room: Room | None = None, origin: np.ndarray | None = None,
        turntable: Turntable | None = None,
    ):  # fmt: skip
        super().__init__()
        self.field = field
        self.environment = environment
        self.neural = neural
        self.room = room
        self.origin = np.zeros(3) if origin is None else np.asarray(origin, dtype=np.float64)
        self.turntable = turntable
        self.occupancy = Occupancy(cells, field.centre.device)
        self.probes = Probes()

    @property
    def device(self) -> torch.device:
        return self.field.centre.device

    def turn_for(self, camera: Camera) -> Tensor | None:
        """By which [3, 3] the light is turned for a camera of the scene's world; None: it stands still."""
        if self.turntable is None:
            return None
        return torch.from_numpy(self.turntable.turn_of(camera)).to(self.device, torch.float32)

    def normal_tables(self):
        """What `surface` needs for normals; holds for one state of the parameters."""
        return self.field.normal_factors()

    def sample(
        self, origins: Tensor, directions: Tensor, start: Tensor,
        offset: Tensor, step_voxels: float, min_transmittance: float,
    ) -> Steps:  # fmt: skip
        """Density samples along world rays [R, 3] with unit directions.

        Args:
            start: [R] distance before which nothing is sampled.
            offset: [R] of the samples, in steps, in [0, 1).
        """
        field = self.field
        step = step_voxels * field.voxel
        found = march(
            field.to_box(origins), field.directions_to_box(directions), start, offset, step,
            self.cell, self.occupancy.free, field.density_planes, field.density_lines,
            field.density_shift, field.density_scale, min_transmittance,
        )  # fmt: skip
        depth = field.extinction(field.raw_density(found.points, found.raw)) * step
        return Steps(depth, found.distance, found.ray, found.offsets)

    def surface(self, points: Tensor, part: Tensor | None, normal_tables) -> Surface:
        """Normals, features and materials at world points [S, 3]."""
        field = self.field
        box_points = field.to_box(points)
        features = field.features(box_points)
        normals = field.normals(box_points, normal_tables)
        return Surface(normals, features, field.materials(features), self.self_shadow)

    def surface_normals(self, points: Tensor, part: Tensor | None, normal_tables) -> Tensor:
        """Unit outward normals [S, 3] at world points [S, 3]."""
        return self.field.normals(self.field.to_box(points), normal_tables)

    def neural_term(self, part, features, half, light, alpha) -> Tensor:
        """g [N, 3] of local directions (see `NeuralTerm`)."""
        return self.neural(features, half, light, alpha)

    def grid_transmittance(self, origins: Tensor, directions: Tensor, start: Tensor) -> Tensor:
        """Transmittance [K] of world rays through the occupancy grid, no gradient."""
        field = self.field
        return grid_transmittance(
            field.to_box(origins), field.directions_to_box(directions), start, self.cell,
            self.occupancy.blocking,
        )  # fmt: skip

    def irradiance(
        self, points: Tensor, part: Tensor | None, normals: Tensor, light: LightTables
    ) -> Tensor:
        """Irradiance [S, 3] of surfaces at world points [S, 3] with unit outward normals."""
        if self.probes.arriving is None:
            return irradiance(light.irradiance[0], normals)
        lifted = self.before_surface(points, normals, self.probes.nodes[0].spacing)
        return self.probes.irradiance(light.irradiance, 0, lifted, normals)

    def before_surface(self, points: Tensor, normals: Tensor, spacing: float) -> Tensor:
        """Box points [S, 3] where the light on surfaces at world points is looked up among probes."""
        lift = LIFT_NODES * spacing * self.field.to_axes(normals.detach())
        return self.field.to_box(points.detach()) + lift

    def new_probes(self) -> tuple[list[Nodes], Tensor, Tensor | None]:
        """Nodes close to the surface as it is now, where they are [P, 3], world, and their parts."""
        nodes, points = nodes_of(self.occupancy.optical_depth(), 1)
        return [nodes], self.field.from_box(points), None

    def probe_rows(self, hits: Tensor, directions: Tensor) -> Tensor:
        """Rows [K] of the probes before what rays of directions [K, 3] hit at world points [K, 3]."""
        return self.probes.nearest_rows(0, self.before_hit(hits, directions))

    def before_hit(self, hits: Tensor, directions: Tensor) -> Tensor:
        """Box points [K, 3] a cell before what rays hit."""
        return self.field.to_box(hits - self.cell * directions)

    def look_around(self, points: Tensor, directions: Tensor) -> tuple[Tensor, Tensor]:
        """What arrives at world points [P, 3] from far away in directions [J, 3]: its share [P, J], and
        at which distances [P, J] half of it is stopped, or infinity."""
        field = self.field
        return look_around(
            field.to_box(points), field.directions_to_box(directions), FRINGE_CELLS * self.cell,
            self.cell, self.occupancy.blocking,
        )  # fmt: skip

    def blockers(self, reach: float) -> Blockers:
        """What `grid_transmittance` looks at, for the fused kernel."""
        field = self.field
        corner = field.from_box(field.centre.new_zeros(1, 3))[0]
        axes = field.centre.new_empty(0, 3) if field.axes is None else field.axes
        return Blockers(corner, axes, 2 * field.half_size, self.cell, self.occupancy.blocking, reach)

    @property
    def cell(self) -> float:
        """Edge of an occupancy cell, world units."""
        return 2 * self.field.half_size / self.occupancy.cells

    @property
    def self_shadow(self) -> float:
        """Height above its origin from which a ray can be blocked, world units."""
        return SELF_SHADOW_VOXELS * max(self.cell, self.field.voxel)


class StepTables(NamedTuple):
    """Lookup tables that hold for one state of the parameters; build them once a step."""

    light: LightTables
    normals: object  # nested tuples or lists of tensors

    @classmethod
    def of(cls, scene: Scene, turn: Tensor | None = None) -> "StepTables":
        """As `SharedTables.of`, under one turn of the light."""
        return SharedTables.of(scene, (turn,)).under(0)

    @classmethod
    def seen_by(cls, camera: Camera, scene: Scene) -> "StepTables":
        """The same, as a photo of this camera (of the scene's world) would have them."""
        return cls.of(scene, scene.turn_for(camera))


class SharedTables(NamedTuple):
    """Tables of one state of the parameters, under each of its light's turns."""

    lights: list[LightTables]
    normals: object  # nested tuples or lists of tensors

    @classmethod
    def of(cls, scene: Scene, turns: Sequence[Tensor | None]) -> "SharedTables":
        """Tables of the current parameters of a scene or a composition.

        Args:
            turns: [3, 3] each by which the light is turned, or None.
        """
        lights = [scene.environment.tables(scene.probes.arriving, turn) for turn in turns]
        return cls(lights, scene.normal_tables())

    def under(self, turn: int) -> StepTables:
        """Those of one of the turns."""
        return StepTables(self.lights[turn], self.normals)

    def cut(self) -> "SharedTables":
        """A copy cut off from the parameters, so that several backward passes share one set."""
        return mapped(lambda value: value.detach().requires_grad_(value.requires_grad), self)

    def carry(self, cut: "SharedTables") -> None:
        """Carry the gradients of a copy that was cut off to the parameters."""
        both = zip(tensors_of(self), tensors_of(cut), strict=True)
        reached = [(value, leaf.grad) for value, leaf in both if leaf.grad is not None]
        if reached:
            torch.autograd.backward(*zip(*reached, strict=True))
