"""`solver evaluate`: a fitted scene against held-out photos and whatever truth lies beside them.

Beside a photo NAME.png: NAME_normal.exr (world space), NAME_albedo (base colour; sRGB as .png, linear
as .exr), NAME_roughness and NAME_metallic (linear, .png or .exr), NAME_hdr.exr (linear radiance,
premultiplied). Beside the camera file: env.exr, the true light; and folders relight_X, the same object
under another light, which is relight_X/env.exr or relight_X.exr. Their photos are those of
transforms_relight_X.json, else those that bear the names of this camera file's.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from .. import __version__
from ..brdf.microfacet import DIELECTRIC_F0
from ..capture.camera import Camera
from ..capture.capture import Capture
from ..capture.photos import (
    Photo,
    load_photos,
    read_exr,
    read_exr_channels,
    read_image,
    srgb_to_linear,
)
from ..capture.read import read_capture
from ..job.folder import JobFolder, write_json_atomic
from ..metrics.image import flip, lpips, ms_ssim, psnr, ssim
from ..metrics.material import environment_errors, weighted_mae
from ..metrics.normals import normal_mae, normal_mae_masked
from ..metrics.scale import LeastSquaresFactor, clipped_factor
from ..render.image import RenderedView
from ..render.scene import Scene
from .exposure import brought_to
from .load import background_of_job, load_job, load_light, render_cameras
from .preview import display, over_plain
from .settings import Settings
from .start import background_shown

BLACK = 1e-3
"""linear; a true albedo that is nowhere above it is none"""


def evaluate_job(
    job: JobFolder, cameras: Path, out: Path | None = None, rays: int = 64,
    neural: float | None = None, photos_folder: Path | None = None,
) -> dict:  # fmt: skip
    """Score a job's renders; prints a line a view and the means.

    Args:
        cameras: camera file with photos. photos_folder: if they are not below its folder.
        out: where to write everything as JSON.
        rays: secondary rays a pixel.
        neural: share of the neural term; None: as the fit ended.

    Returns:
        `mean` of all views' scores, the scores of all `views`, and, where there is truth (and not all is
        metal), `albedo_factor` and `light_factor`.

    Raises:
        CaptureError, JobError: unusable cameras, photos or job.
    """
    capture = read_capture(cameras, photos=photos_folder, fewest=1)
    scene, settings = load_job(job)
    if not job.is_complete():
        print(
            f"{job.root}: this job is not finished; its checkpoint is evaluated.", file=sys.stderr
        )
    photos = load_photos(capture, settings=settings.photos)
    rendered = list(render_cameras(scene, settings, capture.cameras, rays, neural))
    behind = background_shown(photos, background_of_job(job))
    views = {}
    for (camera, view), photo in zip(rendered, photos, strict=True):
        exposed = brought_to(view, photo, behind, settings.fit.exposure)
        views[camera.name] = scores = image_scores(
            display(exposed, behind), over_plain(photo.pixels, behind)
        )
        scores.update(_normal_scores(camera, view, photo))
        print(camera.name, _text(scores), flush=True)
    result = {"views": views, "code_version": __version__, "cameras": str(cameras)}
    factor = _material_scores(rendered, photos, views)
    mean = _mean(list(views.values()))
    if factor is not None:
        result["albedo_factor"] = factor.tolist()
    mean.update(_light_scores(scene, capture.source.parent / "env.exr", factor))
    relight = _relight_scores(scene, settings, capture, rays, neural)
    if relight:
        result["relight"] = relight
        names = ("psnr", "ssim", "ms_ssim", "flip", "lpips", "psnr_without_factor")
        for name in names:
            values = [v["mean"][name] for v in relight.values() if name in v["mean"]]
            if values:
                mean[f"relight_{name}"] = float(np.mean(values))
    result["mean"] = mean
    if out is not None:
        write_json_atomic(out, result)
    print("mean", _text(mean))
    return result


def image_scores(prediction: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """All image metrics of sRGB pictures [H, W, 3]; the prediction is rounded to 8 bits first."""
    prediction = np.round(np.clip(prediction, 0, 1) * 255) / 255
    scores = {
        "psnr": psnr(prediction, truth), "ssim": ssim(prediction, truth),
        "ms_ssim": ms_ssim(prediction, truth), "flip": flip(prediction, truth),
        "lpips": lpips(prediction, truth),
    }  # fmt: skip
    return {name: value for name, value in scores.items() if value is not None}


def _normal_scores(camera: Camera, view: RenderedView, photo: Photo) -> dict[str, float]:
    path = _beside(camera, "_normal.exr")
    if not path.is_file():
        return {}
    values = read_exr(path)[0]
    # As they are, or coded as (n + 1)/2: then nothing is negative.
    truth = values if (values < -1e-3).any() else values * 2 - 1
    alpha = photo.pixels[..., 3]
    scores = {
        "normal_mae": normal_mae(view.normal, truth, alpha),
        "normal_mae_masked": normal_mae_masked(view.normal, truth, alpha),
    }
    return {name: value for name, value in scores.items() if value is not None}


def _material_scores(rendered, photos, views) -> np.ndarray | None:
    """Add albedo_mae, f0_mae and roughness_mae to views; returns the albedo's factor [3].

    A base colour b with metalness m means albedo b(1 − m) and F0 = 0.04(1 − m) + b·m, linear. Where it is
    metal all over, no albedo is scored and there is no factor: one of zero would make any albedo right.
    """
    fitted, truths, brightest = LeastSquaresFactor(), {}, 0.0
    for (camera, view), photo in zip(rendered, photos, strict=True):
        alpha = photo.pixels[..., 3]
        roughness = _map(camera, "_roughness")
        if roughness is not None:
            error = weighted_mae(np.sqrt(view.alpha), roughness[..., 0], alpha)
            views[camera.name]["roughness_mae"] = error
        base = _map(camera, "_albedo")
        if base is None:
            continue
        if _beside(camera, "_albedo.png").is_file():
            base = srgb_to_linear(base)
        base, metallic = base[..., :3], _map(camera, "_metallic")
        metallic = np.zeros_like(base[..., :1]) if metallic is None else metallic[..., :1]
        albedo = base * (1 - metallic)
        f0 = DIELECTRIC_F0 * (1 - metallic) + base * metallic
        views[camera.name]["f0_mae"] = weighted_mae(view.f0, f0, alpha)
        truths[camera.name] = albedo
        fitted.add(view.albedo, albedo, alpha)
        brightest = max(brightest, float((albedo * alpha[..., None]).max()))
    if brightest < BLACK:
        return None
    for (camera, view), photo in zip(rendered, photos, strict=True):
        if camera.name in truths:
            error = weighted_mae(
                view.albedo * fitted.value, truths[camera.name], photo.pixels[..., 3]
            )
            views[camera.name]["albedo_mae"] = error
    return fitted.value


def _light_scores(scene: Scene, path: Path, albedo_factor: np.ndarray | None) -> dict[str, float]:
    """Errors of the recovered light, after its own factor and after the albedo's (its inverse)."""
    if not path.is_file():
        return {}
    truth, _ = read_exr(path)
    light = scene.environment.image()
    scores = {f"environment_{k}": v for k, v in environment_errors(light, truth).items()}
    if albedo_factor is not None and (albedo_factor > 1e-3).all():
        errors = environment_errors(light, truth, 1 / albedo_factor)
        scores |= {f"environment_{k}_albedo_factor": v for k, v in errors.items()}
    return scores


def _relight_scores(
    scene: Scene, settings: Settings, capture: Capture, rays: int, neural: float | None
) -> dict[str, dict]:
    """Scores under every other light there is; one least-squares factor per channel for all its images.

    The paper's protocol (§4), but that the factor is of linear radiance as it is seen, clipped to [0, 1].
    """
    results = {}
    own_light = scene.environment
    for folder in sorted(path for path in capture.source.parent.glob("relight_*") if path.is_dir()):
        lights = (folder / "env.exr", folder.with_suffix(".exr"))
        light = next((path for path in lights if path.is_file()), None)
        relit = _relit_capture(capture, folder)
        if light is None or relit is None:
            continue
        photos = load_photos(relit, settings=settings.photos)
        scene.environment = load_light(light, scene.device)
        rendered = list(render_cameras(scene, settings, relit.cameras, rays, neural))
        predictions = np.concatenate([view.radiance.reshape(-1, 3) for _, view in rendered])
        truths = np.concatenate([photo.pixels[..., :3].reshape(-1, 3) for photo in photos])
        factor = clipped_factor(predictions, truths)
        views = {}
        for (camera, view), photo in zip(rendered, photos, strict=True):
            truth = over_plain(photo.pixels)
            cover = view.opacity[..., None]
            scaled = np.concatenate([view.radiance * factor, cover], axis=-1)
            views[camera.name] = image_scores(over_plain(scaled), truth)
            plain = np.round(display(view) * 255) / 255
            views[camera.name]["psnr_without_factor"] = psnr(plain, truth)
        mean = _mean(list(views.values()))
        name = folder.name.removeprefix("relight_")
        print(f"relit by {name}", _text(mean), flush=True)
        results[name] = {"mean": mean, "factor": factor.tolist(), "views": views}
    scene.environment = own_light
    return results


def _beside(camera: Camera, ending: str) -> Path:
    return camera.image_path.with_name(camera.image_path.stem + ending)


def _relit_capture(capture: Capture, folder: Path) -> Capture | None:
    """The photos of a relight folder with their cameras; None if there are none."""
    cameras = folder.with_name(f"transforms_{folder.name}.json")
    if cameras.is_file():
        return read_capture(cameras, fewest=1)
    moved = [replace(c, image_path=folder / c.image_path.name) for c in capture.cameras]
    there = tuple(camera for camera in moved if camera.image_path.is_file())
    return replace(capture, cameras=there) if there else None


def _map(camera: Camera, ending: str) -> np.ndarray | None:
    """A truth map [H, W, C] as it is stored, PNG scaled to [0, 1]; None if there is none."""
    path = _beside(camera, f"{ending}.exr")
    if path.is_file():
        return read_exr_channels(path)
    path = path.with_suffix(".png")
    return read_image(path) if path.is_file() else None


def _mean(views: list[dict[str, float]]) -> dict[str, float]:
    names = dict.fromkeys(name for scores in views for name in scores)
    return {n: float(np.mean([v[n] for v in views if n in v])) for n in names}


def _text(scores: dict[str, float]) -> str:
    return "  ".join(f"{name} {value:.3f}" for name, value in scores.items())
