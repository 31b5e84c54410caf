"""A fitted scene as the asset sees it: numpy in, numpy out."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from ..capture.camera import Camera
from ..capture.capture import evenly_taken
from ..render.arrays import floats_on
from ..render.image import ray_peaks
from ..render.probing import refresh_probes
from ..render.scene import RenderSettings, Scene, SharedTables
from ..render.shade import diffuse_fresnel
from .build import build_asset
from .errors import EmptySurfaceError
from .far_light import light_from_afar
from .photo_detail import View, are_finer
from .settings import AssetSettings
from .sight import cosines_seen_by

MAX_RAYS = 400_000
MIN_BORDER_RAYS = 50
FEWEST_PHOTOS = 3
"""that must show a place for it to be seen: what one or two show, they would show at many a depth"""
MOST_TURNS = 8
"""of a turntable, whose lights are taken in the mean"""
USUAL_COSINE = 0.8
"""between normals and the ways to cameras that face them"""
POINTS_AT_ONCE = 1 << 17
LEAST_COSINES = 0.5
"""sum of the cosines at which photos show a place, from which on they tell of what it is made"""


class SceneSurface:
    """`SurfaceField` of a scene that was fitted to photos of `cameras`, in the scene's world."""

    def __init__(self, scene: Scene, cameras: list[Camera]):
        self._scene, self._cameras = scene, cameras
        self._field, self._occupancy = scene.field, scene.occupancy
        self.edge, self.voxel = 2 * scene.field.half_size, scene.field.voxel
        self.surrounded = scene.room is not None
        with torch.no_grad():
            self._normal_factors = scene.field.normal_factors()

    def _box_points(self, points: np.ndarray) -> torch.Tensor:
        return self._field.to_box(*floats_on(self._scene.device, points))

    def from_box(self, box_points: np.ndarray) -> np.ndarray:
        """World points [N, 3] of box units, in double precision."""
        offset = (box_points - 0.5) * self.edge
        if self._field.axes is not None:
            offset = offset @ self._field.axes.cpu().numpy().astype(np.float64)
        return self._field.centre.cpu().numpy().astype(np.float64) + offset

    @torch.no_grad()
    def density(self, points: np.ndarray) -> np.ndarray:
        """Extinction [N] per world unit; none where rays never look (`Occupancy.allowed`).

        Outside the allowed space no photo holds the density to anything.
        """
        box_points = self._box_points(points)
        sigma = self._field.extinction(self._field.raw_density(box_points))
        return (sigma * self._occupancy.is_allowed(box_points)).cpu().numpy()

    @torch.no_grad()
    def raw_density(self, count: int) -> np.ndarray:
        """Raw density [K, K, K] at `count` nodes per axis; −∞ where `density` is none."""
        raw = self._field.raw_density_grid(count)
        return raw.masked_fill_(~self._occupancy.allowed_grid(count), -torch.inf).cpu().numpy()

    def raw_level(self, extinction: float) -> float:
        return self._field.raw_of(extinction)

    @torch.no_grad()
    def normals(self, points: np.ndarray) -> np.ndarray:
        return self._field.normals(self._box_points(points), self._normal_factors).cpu().numpy()

    @torch.no_grad()
    def materials(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        materials = self._field.materials(self._field.features(self._box_points(points)))
        return tuple(values.cpu().numpy() for values in materials)

    @torch.no_grad()
    def diffuse_response(self, points: np.ndarray, normals: np.ndarray, f0: np.ndarray) -> np.ndarray:
        """On a turntable, in the mean of its turns."""
        scene = self._scene
        some = [self._cameras[i] for i in evenly_taken(len(self._cameras), MOST_TURNS)]
        turns = (None,) if scene.turntable is None else [scene.turn_for(camera) for camera in some]
        lights = SharedTables.of(scene, turns).lights
        response = np.empty((len(points), 3), np.float32)
        for first in range(0, len(points), POINTS_AT_ONCE):
            part = slice(first, first + POINTS_AT_ONCE)
            at, facing, reflecting = floats_on(scene.device, points[part], normals[part], f0[part])
            light = sum(scene.irradiance(at, None, facing, one) for one in lights) / len(lights)
            cosine = torch.full_like(at[:, 0], USUAL_COSINE)
            sent = diffuse_fresnel(reflecting, cosine) * light / math.pi
            response[part] = sent.cpu().numpy()
        return response

    def seen(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        return self._shown(points, normals, lambda cosines: cosines > 0, FEWEST_PHOTOS)

    def known(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """One photo that faces it, or some at flat angles, tell what a surface is made of."""
        return self._shown(points, normals, lambda cosines: cosines, LEAST_COSINES)

    def _shown(
        self, points: np.ndarray, normals: np.ndarray,
        worth: Callable[[np.ndarray], np.ndarray], enough: float,
    ) -> np.ndarray:  # fmt: skip
        """[N] true where what photos are worth, by the cosines at which they show a point, is enough."""
        total = np.zeros(len(points))
        for camera in self._cameras:
            waiting = np.flatnonzero(total < enough)
            if len(waiting) == 0:
                break
            total[waiting] += worth(cosines_seen_by(camera, self._scene, points[waiting], normals[waiting]))
        return total >= enough


def has_finer_photos(
    scene: Scene, cameras: Sequence[Camera], asset: AssetSettings, size: int | None = None
) -> bool:
    """Whether the albedo gets detail from photos: those of most cameras, in the scene's world and at the
    sizes of the fit, are finer than its field.

    Args:
        size: nodes per axis that the field will have; None: those it has.
    """
    voxel = 2 * scene.field.half_size / ((size or scene.field.size) - 1)
    return asset.photo_detail and are_finer(cameras, scene.field.centre.cpu().numpy(), voxel)


def asset_of(
    scene: Scene, render: RenderSettings, cameras: list[Camera], folder: Path, asset: AssetSettings,
    progress: Callable[[float, str], None], name: str, placement: np.ndarray,
    views: Sequence[View] = (),
) -> dict[str, Any]:  # fmt: skip
    """Write a scene's asset; returns its part of the manifest (see `build_asset`).

    Args:
        cameras: of the photos it was fitted to, in the scene's world, at the sizes it was fitted at.
        views: photos whose detail the albedo gets (see `has_finer_photos`).
        name: of the object in asset.glb.
        placement: [4, 4] similarity from the scene's world to the GLB's.

    Raises:
        EmptySurfaceError: there is no surface.
    """
    level = surface_level(scene, render, cameras)
    surface, light = SceneSurface(scene, cameras), light_from_afar(scene, cameras).image()
    if views and render.diffuse_visibility:
        refresh_probes(scene)  # those of a fit are of some steps before its end
    return build_asset(surface, light, level, folder, asset, progress, name, placement, views)


def surface_level(scene: Scene, settings: RenderSettings, cameras: list[Camera]) -> float:
    """The extinction at which the isosurface has the silhouettes the photos see.

    A ray meets the isosurface of level σ if its highest extinction exceeds σ. So the level at which
    as many rays meet the mesh as are more than half opaque is the typical peak of the rays that are
    half opaque.

    Raises:
        EmptySurfaceError: no ray meets anything opaque, or all go through fog.
    """
    pixels = sum(camera.width * camera.height for camera in cameras)
    stride = max(1, int(np.sqrt(pixels / MAX_RAYS)))
    opacities, peaks = [], []
    for camera in cameras:
        row, column = np.mgrid[0 : camera.height : stride, 0 : camera.width : stride]
        rays = camera.rays(column.ravel() + 0.5, row.ravel() + 0.5)
        opacity, peak = ray_peaks(scene, settings, *floats_on(scene.device, *rays))
        opacities.append(opacity)
        peaks.append(peak)
    opacity, peak = np.concatenate(opacities), np.concatenate(peaks)
    if not (opacity > 0.5).any():
        raise EmptySurfaceError
    border = (opacity > 0.3) & (opacity < 0.7)
    if border.sum() < MIN_BORDER_RAYS:
        # The object fills every photo: any level between empty and solid will do.
        solid = peak[opacity > 0.9]
        if len(solid) == 0:
            raise EmptySurfaceError
        return float(0.2 * np.median(solid))
    return float(np.median(peak[border]))
