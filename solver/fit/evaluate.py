"""`solver evaluate`: a fitted scene against held-out photos and whatever truth lies beside them.

Beside a photo NAME.png: NAME_normal (world space, .exr or .png), NAME_albedo (base colour; sRGB as
.png, linear as .exr), NAME_roughness and NAME_metallic (linear, .png or .exr), NAME_hdr.exr (linear
radiance, premultiplied). Beside the camera file: env.exr, the true light; and folders relight_X, the
same object under another light, which is relight_X/env.exr or relight_X.exr. Their photos are those of
transforms_relight_X.json, else those that bear the names of this camera file's.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from .. import __version__
from ..capture.camera import Camera
from ..capture.capture import Capture
from ..capture.photos import Photo, load_photos, read_exr
from ..capture.read import read_capture
from ..capture.told import without_untold
from ..job.folder import JobFolder
from ..job.request import JobError
from ..metrics.image import flip, lpips, ms_ssim, psnr, ssim, true_where_told
from ..metrics.material import environment_errors
from ..metrics.normals import normal_mae, normal_mae_masked
from ..metrics.scale import clipped_factor
from ..render.image import RenderedView
from ..render.scene import Scene
from ..replacing import write_json_atomic
from ..streams import print_result
from .exposure import brought_to
from .load import background_of_job, held_out_photos, load_job, load_light, render_cameras
from .material_scores import MaterialScores
from .preview import display, over_plain
from .settings import Settings
from .start import background_shown
from .truth import true_normals


def evaluate_job(
    job: JobFolder, cameras: Path, out: Path | None = None, rays: int = 64,
    neural: float | None = None, photos_folder: Path | None = None, ignored: Path | None = None,
) -> dict:  # fmt: skip
    """Score a job's renders; prints a line a view and the means.

    Args:
        cameras: camera file with photos. photos_folder: if they are not below its folder.
        out: where to write everything as JSON.
        rays, neural: as in `render_cameras`.
        ignored: of the photos, as `read_capture` takes it.

    Returns:
        `mean` of all views' scores, the scores of all `views`, and, where there is truth (and not all is
        metal), `albedo_factor` and `light_factor`.

    Raises:
        CaptureError, JobError: unusable cameras, photos or job.
    """
    if out is not None and out.is_dir():
        raise JobError(f"{out}: this is a folder; name a file for the scores, such as metrics.json.")
    capture = read_capture(cameras, photos=photos_folder, fewest=1, ignored=ignored)
    scene, settings = load_job(job)
    if not job.is_complete():
        print(f"{job.root}: this job is not finished; its checkpoint is evaluated.", file=sys.stderr)
    photos = held_out_photos(job, capture, settings)
    behind = background_shown(photos, background_of_job(job))
    views, materials = {}, MaterialScores()
    # View by view: all buffers of the paper's 200 views would take 9 GB.
    rendered = render_cameras(scene, settings, capture.cameras, rays, neural)
    for (camera, view), photo in zip(rendered, photos, strict=True):
        exposed = brought_to(view, photo, behind, settings.fit.exposure)
        views[camera.name] = scores = image_scores(
            display(exposed, behind), over_plain(photo.pixels, behind), photo.told
        )
        scores.update(_normal_scores(camera, view, photo))
        scores.update(materials.add(camera, view, photo.cover))
        print_result(f"{camera.name} {_text(scores)}")
    result = {"views": views, "code_version": __version__, "cameras": str(cameras)}
    factor = materials.albedo_factor
    for name, errors in materials.albedo_errors():
        views[name].update(errors)
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
    print_result(f"mean {_text(mean)}")
    return result


def image_scores(
    prediction: np.ndarray, truth: np.ndarray, told: np.ndarray | None = None
) -> dict[str, float]:
    """All image metrics of sRGB pictures [H, W, 3]; the prediction is rounded to 8 bits first.

    Args:
        told: [H, W] bool, where the truth says something; None: everywhere.
    """
    prediction = np.round(np.clip(prediction, 0, 1) * 255) / 255
    whole = true_where_told(prediction, truth, told)
    scores = {
        "psnr": psnr(prediction, truth, told), "ssim": ssim(prediction, truth, told),
        "ms_ssim": ms_ssim(prediction, whole), "flip": flip(prediction, truth, told),
        "lpips": lpips(prediction, whole),
    }  # fmt: skip
    return {name: value for name, value in scores.items() if value is not None}


def _normal_scores(camera: Camera, view: RenderedView, photo: Photo) -> dict[str, float]:
    truth = true_normals(camera)
    if truth is None:
        return {}
    alpha = photo.cover
    scores = {
        "normal_mae": normal_mae(view.normal, truth, alpha),
        "normal_mae_masked": normal_mae_masked(view.normal, truth, alpha),
    }
    return {name: value for name, value in scores.items() if value is not None}


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
    own_light = scene.environment, scene.turntable
    for folder in sorted(path for path in capture.source.parent.glob("relight_*") if path.is_dir()):
        lights = (folder / "env.exr", folder.with_suffix(".exr"))
        light = next((path for path in lights if path.is_file()), None)
        relit = _relit_capture(capture, folder)
        if light is None or relit is None:
            continue
        photos = load_photos(relit, settings=settings.photos)
        scene.environment, scene.turntable = load_light(light, scene.device), None
        seen = render_cameras(scene, settings, relit.cameras, rays, neural)
        rendered = [view.premultiplied for _, view in seen]
        factor = _factor_of_all(rendered, photos)
        views = {}
        for camera, picture, photo in zip(relit.cameras, rendered, photos, strict=True):
            truth, scale = over_plain(photo.pixels), np.append(factor, 1)
            views[camera.name] = image_scores(over_plain(picture * scale), truth, photo.told)
            plain = np.round(over_plain(picture) * 255) / 255
            views[camera.name]["psnr_without_factor"] = psnr(plain, truth, photo.told)
        mean = _mean(list(views.values()))
        name = folder.name.removeprefix("relight_")
        print_result(f"relit by {name} {_text(mean)}")
        results[name] = {"mean": mean, "factor": factor.tolist(), "views": views}
    scene.environment, scene.turntable = own_light
    return results


def _factor_of_all(rendered: list[np.ndarray], photos: list[Photo]) -> np.ndarray:
    predictions, truths = [], []
    for picture, photo in zip(rendered, photos, strict=True):
        # Where there is nothing in either, any factor is as good.
        filled = (picture[..., :3] != 0).any(-1) | (photo.pixels[..., :3] != 0).any(-1)
        filled = without_untold(filled, photo.told)
        predictions.append(picture[filled, :3])
        truths.append(photo.pixels[filled, :3])
    return clipped_factor(np.concatenate(predictions), np.concatenate(truths))


def _relit_capture(capture: Capture, folder: Path) -> Capture | None:
    cameras = folder.with_name(f"transforms_{folder.name}.json")
    if cameras.is_file():
        return read_capture(cameras, fewest=1)
    moved = [replace(c, image_path=folder / c.image_path.name) for c in capture.cameras]
    there = tuple(camera for camera in moved if camera.image_path.is_file())
    return replace(capture, cameras=there) if there else None


def _mean(views: list[dict[str, float]]) -> dict[str, float]:
    names = dict.fromkeys(name for scores in views for name in scores)
    return {n: float(np.mean([v[n] for v in views if n in v])) for n in names}


def _text(scores: dict[str, float]) -> str:
    return "  ".join(f"{name} {value:.3f}" for name, value in scores.items())
