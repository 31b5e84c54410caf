"""Render and evaluate the field of a job (`solver render`, `solver evaluate`)."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch

from ..asset.files import write_exr
from ..capture.camera import Camera
from ..capture.errors import CaptureError
from ..capture.photos import load_photos, read_exr
from ..capture.read import read_capture
from ..job.folder import JobFolder, write_json_atomic
from ..light.environment import EnvironmentMap
from ..metrics.image import psnr, ssim
from ..metrics.normals import normal_mae
from ..render.image import RenderedView, image_settings, render_view
from ..render.scene import Scene, StepTables
from . import checkpoint
from .presets import Settings, neural_share
from .preview import display, over_white, save_png
from .reconstruct import choose_device


def load_job(job: JobFolder, environment: Path | None = None) -> tuple[Scene, Settings]:
    """The fitted scene of a job, under its own light or the equirect EXR `environment`.

    Raises:
        JobError, CaptureError: no checkpoint, or no usable light.
    """
    scene, state, _ = checkpoint.load_scene(job.checkpoint_dir, choose_device(job.request.device))
    if environment is not None:
        if not environment.is_file():
            raise CaptureError(environment, "", "there is no such file", "check --environment")
        radiance, _ = read_exr(environment)
        if radiance.shape[1] != 2 * radiance.shape[0]:
            raise CaptureError(
                environment, "", f"it is {radiance.shape[1]} × {radiance.shape[0]} pixels",
                "give an equirectangular map, twice as wide as high",
            )  # fmt: skip
        light = EnvironmentMap.from_radiance(torch.from_numpy(radiance.copy()))
        scene.environment = light.to(scene.field.centre.device)
    return scene, checkpoint.settings_of(state)


def render_cameras(
    scene: Scene, settings: Settings, cameras: tuple[Camera, ...], rays: int
) -> Iterator[tuple[Camera, RenderedView]]:
    """Render cameras one by one, with the share of the neural term that the fit ended with."""
    tables = StepTables.of(scene)
    render = image_settings(settings.render, rays, neural_share(settings.fit, 1.0))
    for camera in cameras:
        yield camera, render_view(scene, tables, render, camera)


def render_job(
    job: JobFolder, cameras: Path, out: Path, environment: Path | None, rays: int
) -> None:
    """Write NAME.png, NAME_linear.exr, _normal, _albedo, _roughness and _f0 for every camera."""
    capture = read_capture(cameras)
    scene, settings = load_job(job, environment)
    out.mkdir(parents=True, exist_ok=True)
    for camera, view in render_cameras(scene, settings, capture.cameras, rays):
        name = camera.name
        save_png(display(view), out / f"{name}.png")
        premultiplied = np.concatenate([view.radiance, view.opacity[..., None]], axis=-1)
        write_exr(out / f"{name}_linear.exr", {"RGBA": premultiplied})
        write_exr(out / f"{name}_normal.exr", {"RGB": view.normal})
        write_exr(out / f"{name}_albedo.exr", {"RGB": view.albedo})
        write_exr(out / f"{name}_f0.exr", {"RGB": view.f0})
        roughness = {"alpha": view.alpha, "roughness": np.sqrt(view.alpha)}
        write_exr(out / f"{name}_roughness.exr", roughness)


def evaluate_job(job: JobFolder, cameras: Path, out: Path | None) -> dict:
    """Compare renders with photos; normals too where NAME_normal.exr lies beside a photo."""
    capture = read_capture(cameras)
    photos = load_photos(capture)
    scene, settings = load_job(job)
    views = {}
    for photo, (camera, view) in zip(
        photos, render_cameras(scene, settings, capture.cameras, 64), strict=True
    ):
        # 8 bits, as the pictures that are written and as others score them.
        prediction = np.round(display(view) * 255) / 255
        truth = over_white(photo.pixels)
        scores = {"psnr": psnr(prediction, truth), "ssim": ssim(prediction, truth)}
        normals = camera.image_path.with_name(f"{camera.image_path.stem}_normal.exr")
        if normals.is_file():
            expected = _true_normals(read_exr(normals)[0])
            scores["normal_mae"] = normal_mae(view.normal, expected, photo.pixels[..., 3])
        views[camera.name] = scores
        print(camera.name, "  ".join(f"{k} {v:.3f}" for k, v in scores.items()), flush=True)
    names = sorted({name for scores in views.values() for name in scores})
    mean = {n: float(np.mean([v[n] for v in views.values() if n in v])) for n in names}
    result = {"mean": mean, "views": views, "cameras": str(cameras)}
    if out is not None:
        write_json_atomic(out, result)
    print("mean", "  ".join(f"{k} {v:.3f}" for k, v in mean.items()))
    return result


def _true_normals(values: np.ndarray) -> np.ndarray:
    """Normals of an EXR: as they are, or coded as (n + 1)/2 (then nothing is negative)."""
    return values if (values < -1e-3).any() else values * 2 - 1
