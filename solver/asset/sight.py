"""What of a scene's surface a photo shows."""

import numpy as np
import torch

from ..capture.camera import Camera
from ..capture.frames import unit
from ..render.arrays import floats_on
from ..render.scene import Scene

SEEN_TRANSMITTANCE = 0.3
"""a point is seen if more than this of its light gets to a camera: the grid's cells are coarse"""
GRAZING_COSINE = 0.1
"""between a surface's normal and the flattest look at it that still shows it"""


@torch.no_grad()
def cosines_seen_by(camera: Camera, scene: Scene, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """[N] cosines between outward normals [N, 3] and the ways to a camera of the scene's world, where that
    shows the surface at points [N, 3]; else 0."""
    towards = unit(camera.position - points, 1e-12)
    cosines = (towards * normals).sum(1)
    seen = (cosines > GRAZING_COSINE) & camera.in_frame(points)
    origins, directions = floats_on(scene.device, points[seen], towards[seen])
    start = torch.full((len(origins),), scene.self_shadow, device=scene.device)
    passing = scene.grid_transmittance(origins, directions, start).cpu().numpy()
    seen[seen] = passing > SEEN_TRANSMITTANCE
    return np.where(seen, cosines, 0.0)
