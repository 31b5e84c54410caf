"""Whole images of a fitted scene: radiance and the maps of what the surface is made of."""

import dataclasses
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ..capture.camera import Camera
from ..kernels.march import composite
from .arrays import floats_on
from .pixels import keys_of_rays, mean_of_rays, pixels_of, places_in_pixel, secondary_rays_each
from .radiance import render_rays
from .random_numbers import RandomNumbers
from .scene import RenderSettings, Scene, Steps, StepTables
from .surroundings import surroundings

RAYS_PER_CHUNK, ON_A_CARD = 4096, 32_768
"""at once; a card is busy only with many"""
PEAK_RAYS = 16_384
"""whose steps are kept at once to find their peaks"""


@dataclass(frozen=True)
class RenderedView:
    """Buffers [H, W, …] float32 of one view, row 0 on top."""

    radiance: np.ndarray  # [H, W, 3] linear Rec.709, premultiplied
    opacity: np.ndarray  # [H, W]
    normal: np.ndarray  # [H, W, 3] world, unit, zero where empty
    albedo: np.ndarray  # [H, W, 3] linear, zero where empty
    alpha: np.ndarray  # [H, W] GGX α, zero where empty
    f0: np.ndarray  # [H, W, 3] linear, zero where empty
    surrounded: np.ndarray  # [H, W, 3] linear Rec.709, in its room and before its light; opaque

    @property
    def premultiplied(self) -> np.ndarray:
        """Radiance with opacity, [H, W, 4]."""
        return np.concatenate([self.radiance, self.opacity[..., None]], axis=-1)


def image_settings(
    settings: RenderSettings, secondary_rays: int = 64, neural: float = 0.0
) -> RenderSettings:
    """Settings for final images: more secondary rays; if any is retraced, every blocked one is.

    So no ray's fate depends on which others are rendered with it.

    Args:
        secondary_rays: a pixel; shared among the primary rays through it.
        neural: share of the neural term g; 0 is what Cycles can show.
    """
    return dataclasses.replace(
        settings, neural=neural, neighbour_distance=0.0,
        secondary_rays=secondary_rays_each(secondary_rays, settings.pixel_grid),
        retraced_rays=(1 << 30) if settings.retraced_rays > 0 else 0, secondary_bounce_rays=4,
        shaded_depths=0, secondary_depths=0, emission=0.0,
    )  # fmt: skip


@torch.no_grad()
def render_view(
    scene: Scene, tables: StepTables, settings: RenderSettings, camera: Camera, seed: int = 0,
    rays_per_chunk: int | None = None,
) -> RenderedView:  # fmt: skip
    """Render what a camera sees. The same picture for the same seed, however it is cut in chunks.

    The paper's renderer shares out retraced rays among the pixels of a batch, and so must shuffle
    its images (§3.4); see `image_settings`.
    """
    device = scene.device
    random = RandomNumbers(seed, device)
    places = places_in_pixel(settings.pixel_grid) + 0.5
    row, column = np.mgrid[0 : camera.height, 0 : camera.width]
    columns, rows = column.reshape(-1, 1) + places[:, 0], row.reshape(-1, 1) + places[:, 1]
    pixels, each = columns.shape
    if rays_per_chunk is None:
        rays_per_chunk = ON_A_CARD if device.type == "cuda" else RAYS_PER_CHUNK
    pixels_per_chunk = max(1, rays_per_chunk // each)
    parts, around = [], []
    for first in range(0, pixels, pixels_per_chunk):
        chunk = slice(first, min(first + pixels_per_chunk, pixels))
        rays = floats_on(device, *camera.rays(columns[chunk].ravel(), rows[chunk].ravel()))
        angle = rays[0].new_full((len(rays[0]),), camera.pixel_angle / settings.pixel_grid)
        keys = keys_of_rays(torch.arange(chunk.start, chunk.stop, device=device), each)
        part = render_rays(scene, tables, settings, random, *rays, keys, jitter=False, pixel_angle=angle)
        parts.append(pixels_of(part, each))
        room = surroundings(scene, tables, *rays, angle)
        around.append(mean_of_rays(room.around(part.radiance, part.opacity), each))

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
        surrounded=torch.cat(around).cpu().numpy().reshape(normal.shape),
    )  # fmt: skip


@torch.no_grad()
def ray_opacity(scene: Scene, settings: RenderSettings, origins: Tensor, directions: Tensor) -> Tensor:
    """Opacity [R] of world rays [R, 3], a group of rays after the other."""
    groups = zip(origins.split(PEAK_RAYS), directions.split(PEAK_RAYS), strict=True)
    return torch.cat(
        [_marched(scene, *group, settings.step, settings.min_transmittance)[1] for group in groups]
    )


@torch.no_grad()
def ray_peaks(
    scene: Scene, settings: RenderSettings, origins: Tensor, directions: Tensor
) -> tuple[np.ndarray, np.ndarray]:
    """Opacity [R] and highest extinction [R] of world rays [R, 3], a group of rays after the other."""
    groups = zip(origins.split(PEAK_RAYS), directions.split(PEAK_RAYS), strict=True)
    found = [_ray_peaks(scene, settings, *group) for group in groups]
    opacity, peak = (torch.cat(values).cpu().numpy() for values in zip(*found, strict=True))
    return opacity, peak


def _ray_peaks(
    scene: Scene, settings: RenderSettings, origins: Tensor, directions: Tensor
) -> tuple[Tensor, Tensor]:
    half_step = 0.5 * settings.step
    steps, opacity = _marched(scene, origins, directions, half_step, 1e-3)
    deepest = torch.zeros_like(opacity).scatter_reduce(0, steps.ray, steps.depth, "amax")
    return opacity, deepest / (half_step * scene.field.voxel)


def _marched(
    scene: Scene, origins: Tensor, directions: Tensor, step: float, min_transmittance: float
) -> tuple[Steps, Tensor]:
    """Steps along world rays [R, 3] from their origins, and their opacity [R]."""
    count = len(origins)
    start, offset = origins.new_zeros(count), origins.new_full((count,), 0.5)
    steps = scene.sample(origins, directions, start, offset, step, min_transmittance)
    _, transmittance = composite(steps.depth, steps.offsets)
    return steps, 1 - transmittance
