"""Cameras that a job found to be off are moved to where their photos fit, so that renders fit them, too."""

import bpy
import numpy as np
from mathutils import Matrix

from ...solver.capture.errors import CaptureError
from ...solver.job.folder import JobFolder
from ...solver.job.inputs import cameras_of
from ...solver.job.request import JobError
from .cameras import photo_of, photo_path, to_solver
from .capture_collection import photo_cameras, to_capture_space
from .evaluated import settle
from .job_space import job_space, size_of, stands_elsewhere


def adjust_cameras(job: JobFolder, collection: bpy.types.Collection) -> int:
    """Move a capture's cameras to where the job's result has them; returns how many were moved.

    Those that a person has moved since stay, and all do if the job's capture is gone.
    """
    if not job.cameras_path.is_file():
        return 0
    settle(collection)
    try:
        moved, to_capture = cameras_of(job), to_capture_space(collection)
    except (CaptureError, JobError):
        return 0
    to_space = job_space(job, collection)
    to_space = np.eye(4) if to_space is None else to_space
    pairs = {
        given.image_path.resolve(): (given.placed(to_space), found.placed(to_space))
        for given, found in moved
    }
    size = size_of(np.stack([given.camera_to_world for given, _ in pairs.values()]))
    to_world = to_capture.inverted()
    count = 0
    for item in photo_cameras(collection):
        pair = pairs.get(photo_path(photo_of(item)).resolve())
        if pair is None:
            continue
        try:
            pose = to_solver(item, to_capture).camera_to_world
        except CaptureError:  # a person has made another camera of it
            continue
        if stands_elsewhere(pose, pair[0].camera_to_world, size):
            continue
        item.matrix_world = to_world @ Matrix(pair[1].camera_to_world.tolist())
        count += 1
    return count
