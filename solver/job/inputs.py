"""The capture that a job was asked to reconstruct."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from ..capture.camera import Camera
from ..capture.capture import Capture
from ..capture.errors import CaptureError
from ..capture.placement import suggest_placement
from ..capture.read import held_out_file, read_capture
from .adjusted import adjusted
from .folder import CAPTURE, JobFolder
from .request import JobRequest


def capture_of(job: JobFolder) -> Capture:
    """Read a job's capture; its cameras are those that were adjusted to the photos, if the job has some.

    Cameras that lie in the job's own folder were written there by this program, so they may name
    photos anywhere.

    Raises:
        CaptureError: as `read_capture`. JobError: the adjusted cameras cannot be read.
    """
    capture = _given(job)
    return replace(capture, cameras=adjusted(job.cameras_path, capture.cameras))


def cameras_of(job: JobFolder) -> list[tuple[Camera, Camera]]:
    """Cameras as a job's capture has them, each with what it became if it was adjusted to its photo.

    Raises:
        CaptureError, JobError: as `capture_of`.
    """
    given = _given(job).cameras
    return list(zip(given, adjusted(job.cameras_path, given), strict=True))


def _given(job: JobFolder) -> Capture:
    # Drives and folders have several names, and a job may be resumed by another than it was begun by.
    cameras, own = job.capture_path, (job.root / CAPTURE).resolve()
    return _read(job, cameras, trusted=cameras.resolve().is_relative_to(own))


def held_out_of(job: JobFolder, fitted: Capture) -> Capture | None:
    """The photos that a job's capture holds out, with their cameras; None if it holds out none.

    Args:
        fitted: the capture that it does not hold out.

    Raises:
        CaptureError: as `read_capture`; or the folder of masks has those of the fitted photos alone, and
            some that are held out have the same names.
    """
    file = held_out_file(job.capture_path)
    if file is None:
        return None
    held_out = _read(job, file, fewest=1)
    taken = {camera.mask_path: camera.name for camera in fitted.cameras if camera.mask_path}
    for camera in held_out.cameras:
        if camera.mask_path in taken:
            raise CaptureError(
                file, "masks", f"'{camera.mask_path}' would be the mask of '{camera.name}' as well as "
                f"of the photo '{taken[camera.mask_path]}'",
                "keep masks in folders named like their photos'",
            )  # fmt: skip
    return held_out


def _read(job: JobFolder, cameras: Path, **how) -> Capture:
    request = job.request
    photos, masks, ignored = (
        None if folder is None else Path(folder)
        for folder in (request.photos, request.masks, request.ignored)
    )
    return read_capture(cameras, photos=photos, masks=masks, ignored=ignored, **how)


def region_of(request: JobRequest) -> np.ndarray | None:
    """World box [2, 3] that holds the object, if a job was asked for one."""
    return request.region and np.array([request.region["min"], request.region["max"]], np.float64)


def placement_of(request: JobRequest, capture: Capture) -> np.ndarray:
    """The similarity [4, 4] from the world of a job's capture to the one that asset.glb stands upright in.

    Where a job does not say, it is that by which Blender's import places the capture.
    """
    if request.placement is None:
        return suggest_placement(capture)
    return np.array(request.placement, dtype=np.float64)
