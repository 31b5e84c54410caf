"""The visual hull of photos with masks: where the optimisation starts, and how big the box is."""

from __future__ import annotations

import numpy as np
import scipy.ndimage
import torch
import torch.nn.functional as F

from ..capture.camera import Camera
from ..capture.photos import Photo
from ..field.field import MicrofacetField
from ..kernels.vm import vm_sum


def carve(
    cameras: list[Camera], photos: list[Photo], region: np.ndarray, cells: int,
    threshold: float = 0.5,
) -> np.ndarray:  # fmt: skip
    """Boolean grid [K, K, K] of cell centres of `region` [2, 3] that no photo shows as background.

    A cell outside a photo's frame is not carved by it. Laurentini 1994, doi:10.1109/34.273735.
    """
    axes = [
        region[0, a] + (np.arange(cells) + 0.5) / cells * (region[1, a] - region[0, a])
        for a in range(3)
    ]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    alive = np.arange(len(points))
    for camera, photo in zip(cameras, photos, strict=True):
        pixel, depth = camera.project(points[alive])
        column = np.floor(np.nan_to_num(pixel[:, 0], nan=-1.0)).clip(-1, camera.width)
        row = np.floor(np.nan_to_num(pixel[:, 1], nan=-1.0)).clip(-1, camera.height)
        seen = (depth > 0) & (column >= 0) & (column < camera.width)
        seen &= (row >= 0) & (row < camera.height)
        covered = np.ones(len(alive), dtype=bool)
        covered[seen] = photo.pixels[row[seen].astype(int), column[seen].astype(int), 3] > threshold
        alive = alive[covered]
    hull = np.zeros(len(points), dtype=bool)
    hull[alive] = True
    return hull.reshape(cells, cells, cells)


def bounding_box(hull: np.ndarray, region: np.ndarray) -> np.ndarray:
    """World box [2, 3] around the occupied cells of a grid over `region`."""
    edge = (region[1] - region[0]) / np.array(hull.shape)
    low, high = [], []
    for axis in range(3):
        filled = np.flatnonzero(hull.any(axis=tuple(a for a in range(3) if a != axis)))
        low.append(region[0, axis] + filled[0] * edge[axis])
        high.append(region[0, axis] + (filled[-1] + 1) * edge[axis])
    return np.array([low, high])


def signed_distance(hull: np.ndarray) -> np.ndarray:
    """Distance in cells to the hull's boundary, negative inside."""
    outside = scipy.ndimage.distance_transform_edt(~hull)
    inside = scipy.ndimage.distance_transform_edt(hull)
    distance = np.where(hull, 0.5 - inside, outside - 0.5)
    return scipy.ndimage.gaussian_filter(distance, 1.0).astype(np.float32)


def start_from_hull(
    field: MicrofacetField, distance: torch.Tensor, slope: float, lowest: float, highest: float,
    steps: int, seed: int, progress=None,
) -> float:  # fmt: skip
    """Fit the field's raw density to a ramp across the hull; returns the final RMS error.

    Args:
        distance: [K, K, K] signed distance in world units over the field's box, negative inside.
        slope: raw density gained per world unit of depth.
        lowest, highest: raw density far outside and deep inside.
    """
    parameters = [field.density_planes, field.density_lines]
    optimiser = torch.optim.Adam(parameters, lr=0.02, betas=(0.9, 0.99), fused=True)
    generator = torch.Generator().manual_seed(seed)
    target_grid = (-distance * slope).clamp(lowest, highest)[None, None]
    inside = (distance < 0.1 * 2 * field.half_size).nonzero()
    cells = distance.shape[0]
    error = 0.0
    for step in range(steps):
        for group in optimiser.param_groups:
            group["lr"] = 0.03 * 0.05 ** (step / steps)
        near = inside[torch.randint(len(inside), (24_000,), generator=generator)]
        near = (near + torch.rand(near.shape, generator=generator)) / cells
        points = torch.cat([near, torch.rand(8_000, 3, generator=generator)])
        # grid_sample orders coordinates (z, y, x) for a grid indexed [x, y, z].
        lookup = (points.flip(-1) * 2 - 1).view(1, -1, 1, 1, 3)
        target = F.grid_sample(
            target_grid, lookup, align_corners=False, padding_mode="border"
        ).flatten()
        nodes = field.size - 1
        raw = vm_sum(points * nodes, field.density_planes, field.density_lines)
        loss = ((raw - target) ** 2).mean()
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        optimiser.step()
        error = float(loss.detach()) ** 0.5
        if progress is not None:
            progress(step + 1, steps)
    return error
