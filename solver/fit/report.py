"""report.json and report.html of a job: photos beside the solver's own renders, and numbers."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..asset.files import write_png
from ..capture.camera import Camera
from ..capture.capture import Capture, evenly_taken
from ..capture.errors import CaptureError
from ..capture.photos import Photo, resized
from ..job.events import read_events
from ..job.folder import JobFolder
from ..job.inputs import held_out_of, region_of
from ..metrics.image import psnr, ssim, true_where_told
from ..render.image import render_view
from ..render.scene import Scene, StepTables
from ..replacing import write_json_atomic
from ..report import Row, write_report
from .cut_out import photos_as_fitted
from .exposure import brought_to
from .panorama_file import read_panorama
from .preview import display, over_plain, tone_mapped
from .schedule import picture_settings
from .settings import Settings
from .standing_file import read_standing
from .start import background_shown, uses_masks

VIEWS = 4
CUT_OUT = 24
"""photos that are cut out together, where that takes many"""
MOST_PIXELS = 65_536
"""of a view; larger photos are made smaller, for a render of a phone's photo takes an hour"""


def write_job_report(
    job: JobFolder, scene: Scene, settings: Settings, capture: Capture, photos: list[Photo],
    background: str, numbers: dict[str, float], progress: Callable[[float], None],
    most_pixels: int = MOST_PIXELS,
) -> dict[str, str]:  # fmt: skip
    """Write the report; held-out views if the capture has a test split, else some of the photos.

    Args:
        background: what stands behind the object in the photos that were fitted.
        numbers: to be told besides.
        most_pixels: of a view, at most.
    """
    held_out, warnings = False, warnings_of(job)
    chosen = evenly_taken(len(capture.cameras), VIEWS)
    cameras, images = [capture.cameras[i] for i in chosen], [photos[i] for i in chosen]
    try:
        test = held_out_of(job, capture)
        if test is not None:
            cameras, images = _held_out(job, test, settings, uses_masks(photos, settings))
            held_out = True
    except CaptureError as error:
        # A broken test split must not cost the person a finished reconstruction.
        warnings.append(f"held-out photos cannot be shown: {error}".rstrip("."))
    render_settings = picture_settings(settings)
    behind = background_shown(images, background)
    rows, scores = [], []
    folder = job.result_dir / "report"
    for done, (camera, photo) in enumerate(zip(cameras, images, strict=True)):
        camera = camera.no_larger(most_pixels)
        photo = resized(photo, camera.width, camera.height)
        near = camera.seen_from(scene.origin)
        view = render_view(scene, StepTables.seen_by(near, scene), render_settings, near)
        view = brought_to(view, photo, behind, settings.fit.exposure)
        truth, prediction = over_plain(photo.pixels, behind), display(view, behind)
        score = psnr(prediction, truth, photo.told)
        scores.append((score, ssim(prediction, truth, photo.told)))
        off = np.abs(prediction - true_where_told(prediction, truth, photo.told))
        pictures = {
            "photo": truth, "render": prediction, "difference ×4": off * 4,
            "normals": view.normal * 0.5 + 0.5,
        }  # fmt: skip
        files = []
        for name, pixels in pictures.items():
            file = folder / f"{camera.name}_{name.split()[0]}.png"
            write_png(file, pixels)
            files.append((name, f"report/{file.name}"))
        rows.append(Row(f"{camera.name}: {score:.1f} dB", files))
        progress((done + 1) / len(cameras))
    write_png(folder / "environment.png", tone_mapped(scene.environment.image()))
    rows.append(Row("Recovered light", [("environment", "report/environment.png")]))
    kind = "held-out views" if held_out else "training photos"
    if settings.fit.exposure != "fixed":
        kind += ", each at its photo's exposure"
    numbers = {
        **numbers,
        f"PSNR, dB (mean of {len(cameras)} {kind})": round(float(np.mean([s[0] for s in scores])), 2),
        f"SSIM (mean of {len(cameras)} {kind})": round(float(np.mean([s[1] for s in scores])), 4),
    }
    write_json_atomic(job.result_dir / "report.json", {**numbers, "warnings": warnings})
    write_report(
        job.result_dir / "report.html", "Reconstruction",
        f"Photos beside the solver's own renders of the field ({kind}), "
        + ("without the neural term: what Cycles can show." if render_settings.neural == 0 else
           "with the neural term, which Cycles cannot show."), rows, numbers, warnings,
    )  # fmt: skip
    return {"json": "report.json", "html": "report.html"}


def warnings_of(job: JobFolder) -> list[str]:
    """All that a job has warned of so far, each once: what is resumed warns again."""
    events = read_events(job.events_path)
    return list(dict.fromkeys(event.data["text"] for event in events if event.kind == "warning"))


def _held_out(
    job: JobFolder, test: Capture, settings: Settings, use_masks: bool
) -> tuple[list[Camera], list[Photo]]:
    panorama = read_panorama(job.surroundings_path)
    # Before what is far away, photos tell together where the object is.
    loaded = evenly_taken(len(test.cameras), VIEWS if panorama is None else CUT_OUT)
    test = replace(test, cameras=tuple(test.cameras[i] for i in loaded))
    photos = photos_as_fitted(
        test, settings, use_masks, region_of(job.request), panorama, read_standing(job.standing_path)
    )
    chosen = evenly_taken(len(test.cameras), VIEWS)
    return [test.cameras[i] for i in chosen], [photos[i] for i in chosen]
