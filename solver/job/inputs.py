"""The capture that a job was asked to reconstruct."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..capture.capture import Capture
from ..capture.placement import suggest_placement
from ..capture.read import held_out_file, read_capture
from .folder import JobFolder, JobRequest


def capture_of(job: JobFolder) -> Capture:
    """Read a job's capture.

    Cameras that lie in the job's own folder were written there by this program, so they may name
    photos anywhere.

    Raises:
        CaptureError: as `read_capture`.
    """
    trusted = Path(job.request.capture).is_relative_to(job.root / "capture")
    return _read(job, job.request.capture, trusted=trusted)


def held_out_of(job: JobFolder) -> Capture | None:
    """The photos that a job's capture holds out, with their cameras; None if it holds out none.

    Raises:
        CaptureError: as `read_capture`.
    """
    file = held_out_file(job.request.capture)
    return file and _read(job, file, fewest=1)


def _read(job: JobFolder, cameras: Path | str, **how) -> Capture:
    request = job.request
    photos, masks = (
        None if folder is None else Path(folder) for folder in (request.photos, request.masks)
    )
    return read_capture(cameras, photos=photos, masks=masks, **how)


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
