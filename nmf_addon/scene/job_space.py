"""Where the coordinates of a job are in its capture, as that stands now."""

import numpy as np
from bpy.types import Collection

from ...solver.capture.errors import CaptureError
from ...solver.capture.frames import rigid, scale_and_rotation
from ...solver.job.folder import JobFolder
from ...solver.job.inputs import cameras_of
from ...solver.job.request import JobError
from .cameras import photo_of, photo_path
from .capture_collection import photo_cameras, root_of, to_capture_space
from .evaluated import settle
from .job_capture import from_file

STILL_THERE = 1e-3
"""difference of a matrix, over the capture's size, up to which a camera stands where the job saw it"""


def job_space(job: JobFolder, collection: Collection) -> np.ndarray | None:
    """The similarity [4, 4], in double precision, from a job's coordinates to the space of its capture,
    which is that of the capture's empty; None where both are the same.

    They differ where the job was made from the capture's own file, outside Blender, and where the empty's
    transform was applied (Ctrl+A) since: that gives it another space under cameras that stay.
    """
    try:
        matrix = from_file(collection, JobFolder.open(job.root).capture_path)
        if matrix is not None:
            return _moved_since_import(collection) @ matrix
        return _moved_since(job, collection)
    except (CaptureError, JobError):  # the job's capture is gone
        return None


def _moved_since_import(collection: Collection) -> np.ndarray:
    """What has moved a capture's cameras in its space as one, [4, 4]: that of the empty that they hang on,
    which stays in place when the transform of the capture's empty is applied."""
    above = {item.parent for item in photo_cameras(collection)}
    axes = above.pop() if len(above) == 1 else None
    if axes is None or axes.parent != root_of(collection):
        return np.eye(4)
    settle(collection)
    return np.array(to_capture_space(collection) @ axes.matrix_world)


def _moved_since(job: JobFolder, collection: Collection) -> np.ndarray | None:
    """What has moved the cameras of a job in their capture's space as one; None if nothing has."""
    settle(collection)
    to_capture = to_capture_space(collection)
    poses = {
        photo_path(photo_of(item)).resolve(): np.array((to_capture @ item.matrix_world).normalized())
        for item in photo_cameras(collection)
    }
    pairs = {given.image_path.resolve(): (given, found) for given, found in cameras_of(job)}
    common = [path for path in pairs if path in poses]
    if len(common) < 2:  # of one camera no scale could be told
        return None
    now = np.stack([poses[path] for path in common])
    # As the job was given them, and as an installation has adjusted them.
    before = [np.stack([pairs[path][which].camera_to_world for path in common]) for which in (0, 1)]
    size = size_of(now)
    if any(_most(~stands_elsewhere(there, now, size)) for there in before):
        return None
    motions = (_common_motion(there, now, size) for there in before)
    return next((motion for motion in motions if motion is not None), None)


def stands_elsewhere(poses: np.ndarray, others: np.ndarray, size: float) -> np.ndarray:
    """Which of some poses [..., 4, 4] differ from others, in a capture of a size."""
    allowed = STILL_THERE * np.array([1.0, 1.0, 1.0, size])
    return (np.abs(poses - others) > allowed).any(axis=(-2, -1))


def size_of(poses: np.ndarray) -> float:
    """How far cameras [N, 4, 4] are from their middle, at most."""
    positions = poses[:, :3, 3]
    return float(np.linalg.norm(positions - positions.mean(0), axis=1).max())


def _most(which: np.ndarray) -> bool:
    return bool(2 * which.sum() > len(which))


def _common_motion(before: np.ndarray, now: np.ndarray, size: float) -> np.ndarray | None:
    """The similarity [4, 4] that most of some poses [N, 4, 4] have moved by; None if there is none."""
    places, others = before[:, :3, 3], now[:, :3, 3]
    for one in range(len(now)):  # a person may have moved some by hand
        apart = np.linalg.norm(places - places[one], axis=1)
        far = apart > STILL_THERE * apart.max()
        ratios = np.linalg.norm(others[far] - others[one], axis=1) / apart[far]
        scale = np.median(ratios) if far.any() else 0.0
        if scale == 0:  # they stand at one place
            continue
        turn = scale * now[one, :3, :3] @ before[one, :3, :3].T
        motion = rigid(turn, others[one] - turn @ places[one])
        if _most(~stands_elsewhere(_moved(motion, before), now, size)):
            return motion
    return None


def _moved(matrix: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Poses [N, 4, 4] moved by a similarity, which leaves them rigid."""
    moved = matrix @ poses
    moved[:, :3, :3] /= scale_and_rotation(matrix)[0]
    return moved
