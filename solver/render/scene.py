"""All that is optimised, and the settings of a render of it."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import nn

from ..brdf.neural import NeuralTerm
from ..field.field import MicrofacetField
from ..field.occupancy import Occupancy
from ..light.environment import EnvironmentMap, LightTables


class Scene(nn.Module):
    """Field, light and neural term, with the occupancy grid that follows the field."""

    def __init__(
        self, field: MicrofacetField, environment: EnvironmentMap, neural: NeuralTerm, cells: int
    ):
        super().__init__()
        self.field = field
        self.environment = environment
        self.neural = neural
        self.occupancy = Occupancy(cells, field.centre.device)


@dataclass(frozen=True)
class RenderSettings:
    """How accurately rays are traced. Distances are in voxels of the field's grid."""

    step: float = 0.5
    """distance of density samples along a primary ray, voxels"""
    secondary_step: float = 1.0
    """the same along retraced secondary rays"""
    secondary_rays: int = 16
    """M: secondary rays a pixel, shared among its samples by weight"""
    min_weight: float = 0.01
    """samples that weigh less than this are not shaded; the others make up for them"""
    min_transmittance: float = 1e-3
    """a ray ends where less than this passes"""
    retraced_rays: int = 512
    """R: secondary rays of a batch that are traced through the field once more (0: single bounce)"""
    secondary_bounce_rays: int = 2
    """secondary rays at the end of a retraced ray"""
    neural: float = 1.0
    """1: the BRDF has the full neural term g; 0: g = 1; between: g blended towards 1"""
    visibility: bool = True
    """non-retraced secondary rays see the environment through the occupancy grid's extinction"""
    neighbour_distance: float = 0.0
    """standard deviation, voxels, of the points close by that smoothness terms look at; 0: none"""
    light_masking: bool = True
    """weight G2/G1 of a visible-normal sample is applied (the paper leaves it to g)"""


@dataclass
class StepTables:
    """Lookup tables that hold for one state of the parameters; build them once a step."""

    light: LightTables
    normal_factors: tuple[torch.Tensor, torch.Tensor]

    @classmethod
    def of(cls, scene: Scene) -> StepTables:
        """Tables of the scene's current parameters."""
        return cls(scene.environment.tables(), scene.field.normal_factors())
