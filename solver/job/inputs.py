"""The capture that a job was asked to reconstruct."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ..capture.capture import Capture
from ..capture.read import read_capture
from .folder import JobFolder


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


def in_region(capture: Capture, region: dict[str, list[float]] | None) -> Capture:
    """The capture with the region that a job was asked for, if it was."""
    if region is None:
        return capture
    return replace(capture, region=np.array([region["min"], region["max"]], dtype=np.float64))
