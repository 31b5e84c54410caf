"""Which capture a job was made from."""

import json
from pathlib import Path

import bpy
import numpy as np
from bpy.types import Collection, Context

from ...solver.job.folder import JobFolder
from ...solver.job.request import JobError
from .capture_collection import (
    FILE_TO_CAPTURE,
    SOURCE,
    active_capture,
    is_capture,
    jobs_of,
    photo_paths,
    root_of,
)


def capture_of_job(context: Context, job: JobFolder) -> Collection | None:
    """The capture that a job was made from, in any scene; None if it is not in this file.

    Of a job made in Blender that is one with its photos: at the same place, or under the same names if
    the capture remembers a job of this name, as after a move. Of another job, one imported from its file.
    """
    try:
        source = JobFolder.open(job.root).capture_path
    except JobError:
        return None

    def remembers(capture: Collection) -> bool:
        return job.root.name in jobs_of(capture)

    active = active_capture(context)
    # Collections that captures were sorted into hold the same cameras; those that were imported go first.
    captures = sorted(
        filter(is_capture, [*bpy.data.collections, context.scene.collection]),
        key=lambda c: (not remembers(c), SOURCE not in c, c != active),
    )
    photos = _photos(job.root / "capture" / "transforms_train.json")
    if not photos:
        return next((c for c in captures if _is_imported_from(c, source)), None)
    names = {path.name for path in photos}
    for capture in captures:
        ours = photo_paths(capture)
        if ours & photos or (remembers(capture) and {path.name for path in ours} <= names):
            return capture
    return None


def from_file(collection: Collection, capture: Path) -> np.ndarray | None:
    """From coordinates of the capture's file to capture space as it was made, [4, 4] in double precision.

    None if the collection was not imported from the file (or folder) `capture`.
    """
    root = root_of(collection)
    if root is None or FILE_TO_CAPTURE not in root or not _is_imported_from(collection, capture):
        return None
    return np.reshape(root[FILE_TO_CAPTURE], (4, 4)).astype(np.float64)


def _is_imported_from(collection: Collection, capture: Path) -> bool:
    source = collection.get(SOURCE)
    if not source:
        return False
    file = Path(source).resolve()
    return capture.resolve() in (file, *file.parents)


def _photos(cameras: Path) -> set[Path]:
    """Photos that a job's camera file names; none if Blender has not written one there."""
    try:
        frames = json.loads(cameras.read_text(encoding="utf-8"))["frames"]
        return {Path(frame["file_path"]).resolve() for frame in frames}
    except (OSError, ValueError, KeyError, TypeError):
        return set()
