"""Copy a job's result to where a person wants it."""

from __future__ import annotations

import shutil
from pathlib import Path

from ..job.folder import JobError, JobFolder


def export_result(job: JobFolder, out: Path) -> Path:
    """Copy the whole result folder to a new folder `out`; returns it.

    Raises:
        JobError: no complete result, or `out` exists and is not empty.
    """
    job.manifest()
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise JobError(f"{out}: it exists already; give a new folder.")
    shutil.copytree(job.result_dir, out, dirs_exist_ok=True)
    return out
