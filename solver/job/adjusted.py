"""The cameras of a job that were adjusted to their photos (see `capture.refine`): cameras.json."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..capture.camera import Camera
from ..replacing import write_json_atomic
from .request import JobError, is_similarity


def write_adjusted(path: Path, cameras: Sequence[Camera]) -> None:
    """Write {name: camera-to-world matrix, as four rows}, +X right, +Y up, the view along −Z."""
    write_json_atomic(path, {c.name: c.camera_to_world.tolist() for c in cameras})


def adjusted(path: Path, cameras: Sequence[Camera]) -> tuple[Camera, ...]:
    """Cameras where the file says that they stand; as they are if there is no such file.

    Raises:
        JobError: it cannot be read, or lacks a camera.
    """
    if not path.is_file():
        return tuple(cameras)
    try:
        poses = json.loads(path.read_text(encoding="utf-8"))
        found = []
        for camera in cameras:
            if not is_similarity(poses[camera.name]):
                raise ValueError(f"'{camera.name}' has no rigid motion")
            pose = np.array(poses[camera.name], dtype=np.float64)
            found.append(replace(camera, camera_to_world=pose))
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise JobError(
            f"{path}: the adjusted cameras cannot be read ({error}); delete the job's checkpoint and this "
            "file, or start a new job."
        ) from error
    return tuple(found)
