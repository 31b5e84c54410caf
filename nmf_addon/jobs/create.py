"""New job folders."""

import re
from collections import deque
from collections.abc import Iterator
from itertools import count, takewhile
from pathlib import Path

import bpy

from ...solver import __version__
from ...solver.capture.picture_names import JOBS_FOLDER
from ...solver.job.folder import CAPTURE, JobFolder
from ...solver.job.request import JobRequest
from ..names import JOBS_OF_UNSAVED, user_folder
from ..scene.capture_collection import placement_of, write_capture
from ..scene.evaluated import evaluated
from ..scene.region import region_of

RESERVED = re.compile(r"con|prn|aux|nul|(com|lpt)[0-9¹²³]", re.I)
"""names of devices on Windows, with whatever extension; no file can be called so there"""


def jobs_folder() -> Path:
    """Where new jobs go: beside the saved .blend, else in the extension's own folder."""
    if bpy.data.filepath:
        return Path(bpy.path.abspath(f"//{JOBS_FOLDER}"))
    return user_folder(JOBS_OF_UNSAVED)


def new_job_root(name: str, parent: Path | None = None) -> Path:
    """A folder that does not exist yet, named after a capture."""
    return next(root for root in _job_roots(name, parent) if not root.exists())


def last_job_root(name: str, parent: Path | None = None) -> Path | None:
    """The last folder that `new_job_root` named so, if there is one."""
    last = deque(takewhile(Path.exists, _job_roots(name, parent)), maxlen=1)
    return last[0] if last else None


def _job_roots(name: str, parent: Path | None) -> Iterator[Path]:
    parent = jobs_folder() if parent is None else parent
    # Names have up to 255 letters in Blender, and a path hardly more on Windows.
    stem = re.sub(r"[^\w.\-]+", "_", name)[:60].strip("._") or "job"
    if RESERVED.fullmatch(stem.partition(".")[0]):
        stem = f"_{stem}"
    yield parent / stem
    yield from (parent / f"{stem}_{number}" for number in count(2))


def create_job(collection: bpy.types.Collection, root: Path, **settings) -> JobFolder:
    """Write a job folder for a capture collection: its cameras, region, placement and settings.

    Args:
        settings: fields of `JobRequest`.

    Raises:
        CaptureError, JobError: nothing to reconstruct, or the folder is in use; nothing is written.
    """
    JobFolder.check_new(root)
    folder = root / CAPTURE
    with evaluated(collection):  # once for all that follows
        request = JobRequest(
            capture=str(folder), region=region_of(collection), placement=placement_of(collection),
            code_version=__version__, **settings,
        )  # fmt: skip
        request.check()
        request.capture = str(write_capture(collection, folder))
    return JobFolder.create(root, request, may_hold=[CAPTURE])
