"""Pictures of fitted scenes: `solver render`, under any light, and `solver compose`."""

from pathlib import Path

import numpy as np

from ..asset.files import write_exr, write_png
from ..capture.capture import Capture
from ..capture.read import read_capture
from ..job.folder import JobFolder
from ..job.request import JobError
from ..render.composition import Composition, Placement
from ..render.image import RenderedView
from .load import load_job, load_light, render_cameras
from .preview import display


def render_job(
    job: JobFolder, cameras: Path, out: Path, environment: Path | None = None, rays: int = 64,
    neural: float | None = None,
) -> None:  # fmt: skip
    """Write the pictures of every camera (see `write_view`).

    Args:
        environment: an equirect EXR or another job, whose light replaces the scene's own.
        rays, neural: as in `render_cameras`.

    Raises:
        CaptureError, JobError: unusable cameras, light or job, or a folder that is not free.
    """
    capture = _cameras_of(cameras, out)
    scene, settings = load_job(job)
    if environment is not None:
        scene.environment, scene.turntable = load_light(environment, scene.device), None
    out.mkdir(parents=True, exist_ok=True)
    for camera, view in render_cameras(scene, settings, capture.cameras, rays, neural):
        write_view(view, camera.name, out)


def compose_jobs(
    jobs: list[JobFolder], placements: list[Placement], cameras: Path, out: Path,
    environment: Path | None = None, rays: int = 64, neural: float | None = None,
) -> None:  # fmt: skip
    """Write pictures of several jobs' scenes in one world, traced together.

    Args:
        placements: of every job's scene in the common world.
        environment: as for `render_job`; None: the first job's light.

    Raises:
        CaptureError, JobError: unusable cameras, light or job, or a folder that is not free.
    """
    capture = _cameras_of(cameras, out)
    first, settings = load_job(jobs[0])
    scenes = [first, *(load_job(job, first.device)[0] for job in jobs[1:])]
    light = first.environment
    light.floor = None
    if environment is not None:
        light = load_light(environment, first.device)
    world = Composition(scenes, placements, light)
    out.mkdir(parents=True, exist_ok=True)
    for camera, view in render_cameras(world, settings, capture.cameras, rays, neural):
        write_view(view, camera.name, out)


def _cameras_of(file: Path, out: Path) -> Capture:
    """The cameras of a file whose pictures, which bear the names of their photos, are to be in `out`."""
    capture = read_capture(file, trusted=True, fewest=1, wanted=False)
    if out.exists() and not out.is_dir():
        raise JobError(f"{out}: this is a file; give a folder for the pictures.")
    if out.resolve() in {c.image_path.resolve().parent for c in capture.cameras if c.image_path}:
        raise JobError(f"{out}: the photos of these cameras are here; give another folder.")
    return capture


def write_view(view: RenderedView, name: str, folder: Path) -> None:
    """Write NAME.png, NAME_linear.exr, _normal, _albedo, _roughness and _f0 of a view."""
    write_png(folder / f"{name}.png", display(view))
    write_exr(folder / f"{name}_linear.exr", {"RGBA": view.premultiplied})
    write_exr(folder / f"{name}_normal.exr", {"RGB": view.normal})
    write_exr(folder / f"{name}_albedo.exr", {"RGB": view.albedo})
    write_exr(folder / f"{name}_f0.exr", {"RGB": view.f0})
    roughness = {"alpha": view.alpha, "roughness": np.sqrt(view.alpha)}
    write_exr(folder / f"{name}_roughness.exr", roughness)
