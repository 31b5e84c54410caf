"""Cameras that a job found to be off are moved to where their photos fit, so that renders fit them, too."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

from ...solver.capture.camera import Camera, positions_of
from ...solver.capture.errors import CaptureError
from ...solver.job.folder import JobError, JobFolder
from ...solver.job.inputs import moved_cameras
from .cameras import photo_of, photo_path, to_solver
from .capture_collection import photo_cameras, to_capture_space
from .evaluated import settle
from .job_capture import from_file

STILL_THERE = 1e-3
"""difference of a matrix, over the capture's size, up to which a camera stands where the job saw it"""


def adjust_cameras(job: JobFolder, collection: bpy.types.Collection) -> int:
    """Move a capture's cameras to where the job's result has them; returns how many were moved.

    Those that a person has moved since stay, and all do if the job's capture is gone.
    """
    try:
        moved, source = moved_cameras(job), Path(job.request.capture)
    except (CaptureError, JobError):
        return 0
    if not moved:
        return 0
    settle(collection)
    to_space = from_file(collection, source)
    to_space = np.eye(4) if to_space is None else to_space
    pairs = {
        given.image_path.resolve(): (given.placed(to_space), found.placed(to_space))
        for given, found in moved
    }
    positions = positions_of(given for given, _ in pairs.values())
    size = np.linalg.norm(positions - positions.mean(0), axis=1).max()
    to_capture = to_capture_space(collection)
    to_world = to_capture.inverted()
    count = 0
    for item in photo_cameras(collection):
        pair = pairs.get(photo_path(photo_of(item)).resolve())
        if pair is None or _stands_elsewhere(to_solver(item, to_capture), pair[0], size):
            continue
        item.matrix_world = to_world @ Matrix(pair[1].camera_to_world.tolist())
        count += 1
    return count


def _stands_elsewhere(camera: Camera, given: Camera, size: float) -> bool:
    apart = np.abs(camera.camera_to_world - given.camera_to_world)
    return bool((apart > STILL_THERE * np.array([1.0, 1.0, 1.0, size])).any())
