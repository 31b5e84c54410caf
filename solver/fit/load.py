"""The fitted scene of a job, and other lights for it."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch

from ..capture.camera import Camera
from ..capture.capture import Capture
from ..capture.errors import CaptureError
from ..capture.photos import Photo, read_exr
from ..job.folder import JobFolder
from ..job.inputs import capture_of, region_of
from ..job.request import JobError
from ..light.environment import EnvironmentMap
from ..render.image import RenderedView, render_view
from ..render.probing import refresh_probes
from ..render.scene import Scene, StepTables
from . import checkpoint
from .cut_out import photos_as_fitted
from .devices import device_at_hand
from .panorama_file import read_panorama
from .same_photos import POSES, check_poses
from .schedule import picture_settings
from .settings import Settings
from .standing_file import read_standing


def load_job(job: JobFolder, device: torch.device | None = None) -> tuple[Scene, Settings]:
    """The fitted scene of a job and its settings.

    Args:
        device: None: the one it was fitted on, or this machine's best.

    Raises:
        JobError: no checkpoint.
    """
    chosen = device_at_hand(job.request.device) if device is None else str(device)
    scene, state, _ = checkpoint.load_scene(job.checkpoint_dir, chosen)
    return scene, checkpoint.settings_of(state)


def check_capture(job: JobFolder) -> None:
    """Make sure that a job's capture, which may lie elsewhere now, has the cameras of its checkpoint.

    Raises:
        CaptureError: it cannot be read. JobError: it has others, or the checkpoint is damaged.
    """
    cameras, state = capture_of(job).cameras, checkpoint.read_state(job.checkpoint_dir)
    if state is None:
        return
    poses = checkpoint.read_tensor(job.checkpoint_dir, POSES)
    if len(poses) != len(cameras):
        raise JobError(
            f"{job.capture_path} has {len(cameras)} photos, and the job began with {len(poses)}; give "
            "the capture that it began with, or start a new job."
        )
    check_poses(poses, [camera.seen_from(np.array(state["origin"])) for camera in cameras])


def background_of_job(job: JobFolder) -> str:
    """What stood behind the object in a job's photos (see `FitSettings.background`).

    Raises:
        JobError: no checkpoint.
    """
    return checkpoint.read_state(job.checkpoint_dir)["background"]


def log_gain_of_job(job: JobFolder) -> torch.Tensor | None:
    """Logarithms [P, C] of the exposures of a job's photos; None: it has not looked for any.

    Raises:
        JobError: no checkpoint.
    """
    return checkpoint.read_tensor(job.checkpoint_dir, "exposures.log_gain")


def held_out_photos(job: JobFolder, capture: Capture, settings: Settings) -> list[Photo]:
    """Photos to compare a job's pictures with, loaded and cut out as those of its fit were.

    Raises:
        CaptureError: a photo cannot be used. JobError: no checkpoint.
    """
    use_masks = checkpoint.read_state(job.checkpoint_dir)["use_masks"]
    return photos_as_fitted(
        capture, settings, use_masks, region_of(job.request),
        read_panorama(job.surroundings_path), read_standing(job.standing_path),
    )  # fmt: skip


def load_light(path: Path, device: torch.device) -> EnvironmentMap:
    """A light: an equirect EXR (Blender's convention, linear Rec.709), or that of another job.

    Raises:
        CaptureError: not a usable picture. JobError: a job without checkpoint.
    """
    if path.is_dir():
        scene, _, _ = checkpoint.load_scene(JobFolder.open(path).checkpoint_dir, str(device))
        scene.environment.floor = None
        return scene.environment
    if not path.is_file():
        raise CaptureError(path, "", "there is no such file or job", "check --environment")
    radiance, _ = read_exr(path)
    if radiance.shape[1] != 2 * radiance.shape[0]:
        raise CaptureError(
            path, "", f"it is {radiance.shape[1]} × {radiance.shape[0]} pixels",
            "give an equirectangular map, twice as wide as it is high",
        )  # fmt: skip
    return EnvironmentMap.from_radiance(torch.from_numpy(radiance.copy())).to(device)


def render_cameras(
    scene: Scene, settings: Settings, cameras: tuple[Camera, ...], rays: int, neural: float | None = None
) -> Iterator[tuple[Camera, RenderedView]]:
    """Render cameras of the capture's world one by one; a turntable's light goes round with them.

    Args:
        scene: a `Scene` or a `Composition`.
        rays: secondary rays a pixel.
        neural: share of the neural term; None: as the fit ended.
    """
    if settings.render.diffuse_visibility:
        refresh_probes(scene)  # its light may be another one than that of the fit
    render = picture_settings(settings, rays, neural=neural)
    # They are the same for all cameras, unless the light turns with them.
    tables = StepTables.of(scene) if scene.turntable is None else None
    for camera in cameras:
        near = camera.seen_from(scene.origin)
        seen = tables or StepTables.seen_by(near, scene)
        yield camera, render_view(scene, seen, render, near)
