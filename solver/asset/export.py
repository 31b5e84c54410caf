"""Copy a job's result to where a person wants it."""

from __future__ import annotations

import shutil
from pathlib import Path

from ..job.folder import JobError, JobFolder


def export_result(job: JobFolder, out: Path) -> Path:
    """Copy the whole result folder to a new folder `out`; returns it.

    The folder has its name once all is there: where there is a manifest, the result is complete.

    Raises:
        JobError: no complete result, or `out` exists and is not empty. OSError: it cannot be written.
    """
    job.manifest()
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise JobError(f"{out}: it exists already; give a new folder.")
    part = out.absolute().with_name(f"{out.absolute().name}.part")
    shutil.rmtree(part, ignore_errors=True)
    try:
        shutil.copytree(job.result_dir, part)
        if out.exists():
            out.rmdir()
        part.rename(out)
    except OSError as error:
        shutil.rmtree(part, ignore_errors=True)
        raise _first_of(error, out) from error
    return out


def _first_of(error: OSError, out: Path) -> Exception:
    """The first of the errors that a copy of many files has collected."""
    if isinstance(error, shutil.Error) and error.args and error.args[0]:
        file, _, reason = error.args[0][0]
        return JobError(f"{out}: {Path(file).name} could not be written ({reason}); free space, or give "
                        "another folder.")  # fmt: skip
    return error
