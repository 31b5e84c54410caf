"""A job's result where a person wants it: in a new folder, all of it or nothing."""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..job.folder import MANIFEST, JobFolder, holds_nothing
from ..job.request import JobError
from ..replacing import replace_file


def export_result(job: JobFolder, out: Path) -> Path:
    """Copy the whole result folder to a new folder `out`; returns it.

    The folder has its name once all is there: where there is a manifest, the result is complete.

    Raises:
        JobError, OSError: no complete result, or as `new_folder`.
    """
    job.manifest()
    with new_folder(out) as part:
        # Which may lie in the result's folder itself.
        shutil.copytree(job.result_dir, part, ignore=shutil.ignore_patterns(part.parent.name))
    return out


@contextmanager
def new_folder(out: Path) -> Iterator[Path]:
    """A folder to be made and filled, of which all comes to `out` in the end, its manifest last; if it
    fails, it goes.

    Raises:
        JobError: `out` exists and is not empty. OSError: it cannot be written.
    """
    if out.exists() and not (out.is_dir() and holds_nothing(out)):
        raise JobError(f"{out}: it already exists; give a new folder.")
    # An empty one stays what it is: a link, another disk, where somebody is.
    beside = out if out.exists() else out.absolute().parent
    holder, moves = None, []
    try:
        beside.mkdir(parents=True, exist_ok=True)
        holder = Path(tempfile.mkdtemp(prefix=".export-", dir=beside))
        part = holder / "part"
        yield part
        if beside == out:
            moves = [(path, out / path.name) for path in part.iterdir()]
            moves.sort(key=lambda move: move[0].name == MANIFEST)
            for path, place in moves:
                replace_file(path, place)
        else:
            replace_file(part, out)
    except OSError as error:
        for path, place in moves:
            if place.exists() and not path.exists():
                replace_file(place, path)
        raise _first_of(error, out) from error
    finally:
        if holder is not None:
            shutil.rmtree(holder, ignore_errors=True)


def _first_of(error: OSError, out: Path) -> Exception:
    """The first of the errors that a copy of many files has collected."""
    if isinstance(error, shutil.Error) and error.args and error.args[0]:
        file, _, reason = error.args[0][0]
        return JobError(
            f"{out}: {Path(file).name} could not be written ({reason}); free space, or give another folder."
        )
    return error
