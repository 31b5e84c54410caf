"""Materials and normals from the field into texels."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..capture.frames import unit
from ..capture.told import filled
from .settings import AssetSettings
from .surface import SurfaceField

POINTS_PER_CALL = 1 << 18


@dataclass(frozen=True)
class SurfaceSamples:
    """What the field is like around N surface points; linear Rec.709."""

    albedo: np.ndarray  # [N, 3]
    alpha: np.ndarray  # [N]
    f0: np.ndarray  # [N, 3]
    normals: np.ndarray  # [N, 3] unit, world


def gather(
    field: SurfaceField, points: np.ndarray, normals: np.ndarray, settings: AssetSettings,
    progress: Callable[[float], None] = lambda done: None,
) -> SurfaceSamples:  # fmt: skip
    """Materials around surface points [N, 3], weighted as a ray against `normals` sees them.

    A ray does not see a field at one point but through a layer: each point walks inwards along its
    normal through `settings.march_voxels` and gathers with volume rendering weights.
    """
    length, count = settings.march_voxels * field.voxel, settings.march_samples
    step = length / count
    offsets = (0.5 * length - (np.arange(count) + 0.5) * step).astype(np.float32)
    albedo, alpha = np.empty((len(points), 3), np.float32), np.empty(len(points), np.float32)
    f0, gathered = np.empty_like(albedo), np.empty_like(albedo)
    chunk = POINTS_PER_CALL // count
    for first in range(0, len(points), chunk):
        part = slice(first, first + chunk)
        walk = points[part, None] + offsets[:, None] * normals[part, None]
        flat = np.ascontiguousarray(walk.reshape(-1, 3), dtype=np.float32)
        depth = field.density(flat).reshape(-1, count) * step
        # The last sample takes what is left, so that thin or soft places gather a whole weight.
        before = np.exp(-(np.cumsum(depth, 1) - depth))
        weight = before * (1 - np.exp(-depth))
        weight[:, -1] = before[:, -1]
        a, r, f = field.materials(flat)
        n = field.normals(flat)

        def mean(values, weight=weight):
            return np.einsum("nk,nk...->n...", weight, values.reshape(*weight.shape, *values.shape[1:]))

        albedo[part], alpha[part], f0[part] = mean(a), mean(r), mean(f)
        direction = mean(n)
        # A vanishing or inward mean is no normal; the mesh's own is.
        bad = (direction * normals[part]).sum(1) < 0.1 * np.linalg.norm(direction, axis=1)
        direction[bad] = normals[part][bad]
        gathered[part] = unit(direction, 1e-12)
        progress(min(1.0, (first + chunk) / len(points)))
    return SurfaceSamples(albedo, alpha, f0, gathered)


def fill_texture(size: int, row: np.ndarray, column: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Texture [S, S, C] of texel values [T, C]; empty texels copy the nearest covered one.

    Without that dilation, filtering at chart borders would mix in whatever lies between charts.
    """
    texture = np.zeros((size, size, values.shape[1]), dtype=np.float32)
    covered = np.zeros((size, size), dtype=bool)
    texture[row, column] = values
    covered[row, column] = True
    return filled(texture, covered)
