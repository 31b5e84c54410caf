"""The capture that a job was asked to reconstruct."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..capture.capture import Capture
from ..capture.placement import suggest_placement
from ..capture.read import read_capture
from .folder import JobFolder, JobRequest


def capture_of(job: JobFolder, split: str = "train") -> Capture:
    """Read a job's capture, or another split of it.

    Cameras that lie in the job's own folder were written there by this program, so they may name
    photos anywhere.

    Raises:
        CaptureError: as `read_capture`.
    """
    request = job.request
    return read_capture(
        request.capture, split,
        None if request.photos is None else Path(request.photos),
        None if request.masks is None else Path(request.masks),
        trusted=Path(request.capture).is_relative_to(job.root / "capture"),
    )  # fmt: skip


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
