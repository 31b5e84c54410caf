"""Whole images of a fitted scene: radiance and the maps of what the surface is made of."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from ..capture.camera import Camera
from ..kernels.march import composite, march
from .radiance import render_rays
from .random_numbers import SobolRotations
from .scene import RenderSettings, Scene, StepTables

RAYS_PER_CHUNK = 4096


@dataclass(frozen=True)
class RenderedView:
    """Buffers [H, W, …] float32 of one view, row 0 on top."""

    radiance: np.ndarray  # [H, W, 3] linear Rec.709, premultiplied
    opacity: np.ndarray  # [H, W]
    normal: np.ndarray  # [H, W, 3] world, unit, zero where empty
    albedo: np.ndarray  # [H, W, 3] linear, zero where empty
    alpha: np.ndarray  # [H, W] GGX α, zero where empty
    f0: np.ndarray  # [H, W, 3] linear, zero where empty


def image_settings(settings: RenderSettings, secondary_rays: int = 64) -> RenderSettings:
    """Settings for final images: more secondary rays, every blocked one traced, no g."""
    return dataclasses.replace(
        settings, secondary_rays=secondary_rays, retraced_rays=1 << 30, neural=0.0,
        neighbour_distance=0.0, secondary_bounce_rays=4,
    )  # fmt: skip


@torch.no_grad()
def render_view(
    scene: Scene, tables: StepTables, settings: RenderSettings, camera: Camera, seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> RenderedView:  # fmt: skip
    """Render what a camera sees. The same numbers for the same seed."""
    device = scene.field.centre.device
    random = SobolRotations(seed, device)
    row, column = np.mgrid[0 : camera.height, 0 : camera.width]
    origins, directions = camera.rays(column.ravel() + 0.5, row.ravel() + 0.5)
    origins = torch.from_numpy(origins).float().to(device)
    directions = torch.from_numpy(directions).float().to(device)
    parts = []
    for first in range(0, len(origins), RAYS_PER_CHUNK):
        chunk = slice(first, first + RAYS_PER_CHUNK)
        parts.append(
            render_rays(
                scene, tables, settings, random, origins[chunk], directions[chunk], jitter=False
            )
        )
        if progress is not None:
            progress(min(1.0, (first + RAYS_PER_CHUNK) / len(origins)))

    def image(name: str) -> np.ndarray:
        flat = torch.cat([getattr(part, name) for part in parts]).cpu().numpy()
        return flat.reshape(camera.height, camera.width, *flat.shape[1:])

    opacity = image("opacity")
    filled = opacity > 1e-3
    cover = np.where(filled, opacity, 1.0)

    def straight(name: str) -> np.ndarray:
        values = image(name)
        shape = (..., None) if values.ndim == 3 else ...
        return np.where(filled[shape], values / cover[shape], 0).astype(np.float32)

    normal = image("normal")
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = np.where(filled[..., None] & (length > 1e-6), normal / np.maximum(length, 1e-6), 0)
    return RenderedView(
        radiance=image("radiance"), opacity=opacity, normal=normal.astype(np.float32),
        albedo=straight("albedo"), alpha=straight("alpha"), f0=straight("f0"),
    )  # fmt: skip


@torch.no_grad()
def ray_peaks(
    scene: Scene, settings: RenderSettings, origins: torch.Tensor, directions: torch.Tensor
) -> tuple[np.ndarray, np.ndarray]:
    """Opacity [R] and highest extinction [R] of world rays [R, 3]."""
    field = scene.field
    box_origins, box_directions = field.to_box(origins), field.directions_to_box(directions)
    count = len(origins)
    step = 0.5 * settings.step * field.voxel
    segments = march(
        box_origins, box_directions, origins.new_zeros(count), origins.new_full((count,), 0.5),
        step, scene.occupancy.occupied, field.density_planes, field.density_lines,
        field.density_shift, field.density_scale, 1e-3,
    )  # fmt: skip
    box_points = (
        box_origins[segments.ray] + segments.distance[:, None] * box_directions[segments.ray]
    )
    sigma = field.extinction(field.raw_density(box_points))
    _, transmittance = composite(sigma * step, segments.offsets)
    peak = origins.new_zeros(count).scatter_reduce(0, segments.ray, sigma, "amax")
    return (1 - transmittance).cpu().numpy(), peak.cpu().numpy()
