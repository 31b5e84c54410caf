"""A scene's light with all of it far away, as Blender's World has it.

Where a part of the light is close by (`light.floor`), no such light is right for all of an object. The one
here is near to what photos show: in each direction the mean of what is seen in it from where the object
mirrors it to their cameras.
"""

from typing import NamedTuple

import torch

from ..capture.camera import Camera
from ..capture.capture import evenly_taken
from ..kernels.sphere import look_up
from ..light.environment import EnvironmentMap, equirect_coordinates, equirect_directions, resized_map
from ..light.floor import Floor
from ..render.scene import Scene
from .sight import cosines_seen_by

POINTS = 512
"""on the surface, evenly taken from all, of which it is looked at what they mirror"""
COARSE = 32
"""rows of the map on which it is told who mirrors which direction"""
SHARPNESS = 60.0
"""κ of the lobe exp(κ (cos − 1)), about 7° wide, that a point mirrors to a camera"""
ELSEWHERE = 1e-3
"""of the largest weight: what points count by their cosine in directions that none mirrors"""


class Mirrors(NamedTuple):
    """Points [P, 3] of a surface, world, and how much of each direction [P, h, 2h] they mirror to
    cameras."""

    points: torch.Tensor
    weights: torch.Tensor


@torch.no_grad()
def light_from_afar(scene: Scene, cameras: list[Camera]) -> EnvironmentMap:
    """The scene's own light, if all of it is far; else the far light that is nearest to it.

    Args:
        cameras: of the photos, in the scene's world.
    """
    floor = scene.environment.floor
    if floor is None:
        return scene.environment
    return mean_from(scene.environment, floor, mirrors_of(scene, cameras))


@torch.no_grad()
def mirrors_of(scene: Scene, cameras: list[Camera]) -> Mirrors:
    """What points close to the surface mirror to the cameras that see them."""
    points = scene.new_probes()[1]
    points = points[evenly_taken(len(points), POINTS)]
    normals = scene.surface_normals(points, None, scene.normal_tables())
    origins = points + scene.self_shadow * normals
    begin = torch.full_like(points[:, 0], scene.self_shadow)
    around = equirect_directions(COARSE, 2 * COARSE).float().view(-1, 3).to(points)
    weights = torch.zeros(len(points), len(around), device=points.device)
    on_surface = [value.cpu().numpy() for value in (origins, normals)]
    for camera in cameras:
        view = torch.from_numpy(camera.position).to(points) - points
        view = torch.nn.functional.normalize(view, dim=-1)
        cosine = (view * normals).sum(-1)
        mirrored = 2 * cosine[:, None] * normals - view
        seen = torch.from_numpy(cosines_seen_by(camera, scene, *on_surface)).to(points)
        weight = seen * scene.grid_transmittance(origins, mirrored, begin)
        weights += weight[:, None] * torch.exp(SHARPNESS * (mirrored @ around.T - 1))
    facing = (normals @ around.T).clamp(min=1e-6)
    weights += ELSEWHERE * weights.max().clamp(min=1e-6) * facing
    return Mirrors(points, weights.view(-1, COARSE, 2 * COARSE))


def mean_from(environment: EnvironmentMap, floor: Floor, mirrors: Mirrors) -> EnvironmentMap:
    """In each direction the mean of what the points see in it of a light of which a floor is close by."""
    shape = environment.height, environment.width
    light = environment.radiance()
    directions = equirect_directions(*shape).float().view(-1, 3).to(light)
    mean, total = torch.zeros_like(light), torch.zeros_like(light[0])
    for shift, coarse in zip(floor.shifts(mirrors.points), mirrors.weights, strict=True):
        weight = resized_map(coarse.expand(3, -1, -1), environment.height)[0]
        seen = floor.seen(shift.expand_as(directions), directions).directions
        places = equirect_coordinates(seen, *shape).view(*shape, 2)
        mean += weight * look_up(light, places)
        total += weight
    return EnvironmentMap.from_radiance((mean / total).permute(1, 2, 0)).to(light.device)
