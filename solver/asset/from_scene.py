"""A fitted scene as the asset sees it: numpy in, numpy out."""

from __future__ import annotations

import numpy as np
import torch

from ..capture.camera import Camera
from ..render.image import surface_points
from ..render.scene import RenderSettings, Scene

MAX_RAYS = 60_000


class SceneSurface:
    """`SurfaceField` of a scene."""

    def __init__(self, scene: Scene):
        self._field = scene.field
        centre = scene.field.centre.cpu().numpy().astype(np.float64)
        self.region = np.stack([centre - scene.field.half_size, centre + scene.field.half_size])
        self.voxel = scene.field.voxel
        with torch.no_grad():
            self._normal_factors = scene.field.normal_factors()

    def _box_points(self, points: np.ndarray) -> torch.Tensor:
        tensor = torch.from_numpy(points).float().to(self._field.centre.device)
        return self._field.to_box(tensor)

    @torch.no_grad()
    def density(self, points: np.ndarray) -> np.ndarray:
        """Extinction [N] per world unit."""
        raw = self._field.raw_density(self._box_points(points))
        return self._field.extinction(raw).cpu().numpy()

    @torch.no_grad()
    def normals(self, points: np.ndarray) -> np.ndarray:
        """Unit outward normals [N, 3]."""
        return self._field.normals(self._box_points(points), self._normal_factors).cpu().numpy()

    @torch.no_grad()
    def materials(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Albedo [N, 3], GGX α [N], F0 [N, 3]."""
        materials = self._field.materials(self._field.features(self._box_points(points)))
        return tuple(values.cpu().numpy() for values in materials)


def environment_image(scene: Scene) -> np.ndarray:
    """The light as [H, W, 3] float32 linear Rec.709, Blender's equirect convention."""
    radiance = scene.environment.radiance().detach().permute(1, 2, 0)
    return np.ascontiguousarray(radiance.cpu().numpy(), dtype=np.float32)


def visible_surface_points(
    scene: Scene, settings: RenderSettings, cameras: list[Camera]
) -> np.ndarray:
    """World points [M, 3] at half transmittance along rays spread over all photos."""
    pixels = sum(camera.width * camera.height for camera in cameras)
    stride = max(1, int(np.sqrt(pixels / (4 * MAX_RAYS))))
    found = []
    for camera in cameras:
        row, column = np.mgrid[0 : camera.height : stride, 0 : camera.width : stride]
        origins, directions = camera.rays(column.ravel() + 0.5, row.ravel() + 0.5)
        device = scene.field.centre.device
        found.append(
            surface_points(
                scene, settings, torch.from_numpy(origins).float().to(device),
                torch.from_numpy(directions).float().to(device),
            )
        )  # fmt: skip
    return np.concatenate(found)
