"""A job's result where a person wants it: in a new folder, all of it or nothing."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..job.folder import JobFolder, holds_nothing
from ..job.request import JobError
from ..replacing import replace_file


def export_result(job: JobFolder, out: Path) -> Path:
    """Copy the whole result folder to a new folder `out`; returns it.

    The folder has its name once all is there: where there is a manifest, the result is complete.

    Raises:
        JobError: no complete result, or `out` exists and is not empty. OSError: it cannot be written.
    """
    job.manifest()
    with new_folder(out) as part:
        shutil.copytree(job.result_dir, part)
    return out


@contextmanager
def new_folder(out: Path) -> Iterator[Path]:
    """A folder beside `out`, to be made and filled, that gets its name in the end; if it fails, it goes.

    Raises:
        JobError: `out` exists and is not empty. OSError: it cannot be written.
    """
    if out.exists() and not (out.is_dir() and holds_nothing(out)):
        raise JobError(f"{out}: it already exists; give a new folder.")
    part = out.absolute().with_name(f"{out.absolute().name}.part")
    shutil.rmtree(part, ignore_errors=True)
    try:
        yield part
        if out.exists() and holds_nothing(out):
            shutil.rmtree(out)
        replace_file(part, out)
    except OSError as error:
        raise _first_of(error, out) from error
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _first_of(error: OSError, out: Path) -> Exception:
    """The first of the errors that a copy of many files has collected."""
    if isinstance(error, shutil.Error) and error.args and error.args[0]:
        file, _, reason = error.args[0][0]
        return JobError(f"{out}: {Path(file).name} could not be written ({reason}); free space, or give "
                        "another folder.")  # fmt: skip
    return error
