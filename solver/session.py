"""A long run as others see it: events, heartbeat, cancelling, a bar, and how it ended."""

from __future__ import annotations

import errno
import os
import re
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from . import __version__
from .asset.errors import EmptySurfaceError
from .capture.errors import CaptureError
from .fit.errors import SettingsError
from .job.control import Cancelled, Control
from .job.events import EventStream
from .job.exit_codes import BAD_INPUT, CANCELLED, DONE, FAILED, OUT_OF_MEMORY
from .job.request import JobError
from .job.status import Heartbeat
from .replacing import is_too_long, remove_file
from .streams import say, take_stdout_for_events

if TYPE_CHECKING:
    from .job.begun import Begun
    from .job.progress import Progress

INPUT_ERRORS = (CaptureError, JobError, SettingsError)
KNOWN_FAILURES = (EmptySurfaceError,)
_REMEDIES = {
    **dict.fromkeys((errno.ENOSPC, errno.EDQUOT, errno.EFBIG), "free space or write elsewhere"),
    **dict.fromkeys((errno.EROFS, errno.EACCES, errno.EPERM), "make it writable or write elsewhere"),
}
"""of a disk that takes nothing, by the number of its error"""
_NO_MEMORY = re.compile("out of memory|not enough memory|can't allocate|bad.alloc")
"""as cards, PyTorch on Windows and elsewhere, and C++ say it"""
_NO_MEMORY_ON_WINDOWS = (8, 14, 1455)
"""the last: the paging file cannot grow"""


@dataclass
class Session:
    """What the work inside a session uses; `code` is its exit code once that is over."""

    progress: Progress
    control: Control
    events: EventStream
    code: int = DONE

    def told(self, done: float, text: str) -> None:
        """Tell the share done of the stage, and what is being done; raises `Cancelled` if asked to stop."""
        if self.control.should_stop:
            raise Cancelled
        self.progress.fraction(done, text)


@contextmanager
def session(
    events_path: Path, status_path: Path, cancel_path: Path, to_stdout: bool, has_parent: bool,
    shares: dict[str, float] | None = None, begun: Begun | None = None,
) -> Iterator[Session]:  # fmt: skip
    """Run the body with a heartbeat and events, and tell both how it ended.

    `Cancelled` and Ctrl-C end in the code for that; any other error is told and raised again.

    Args:
        to_stdout: events go there, too, and there is no bar.
        has_parent: whoever started it speaks on stdin (see `Control`).
        shares: of the time that the stages take (see `Progress`).
        begun: what was made for this run; if its input cannot be used, that and the session's own files
            go again, unless there is work to go on with.

    Raises:
        JobError: another process began in the same moment; one that began before is told by its heartbeat.
    """
    stream = take_stdout_for_events() if to_stdout else None
    try:
        events = EventStream(events_path, stream)
    except BlockingIOError as error:
        raise JobError(
            f"{events_path.parent}: another process is working here; cancel it, or wait for it."
        ) from error
    remove_file(cancel_path)
    control = Control(cancel_path, has_parent)
    heartbeat = Heartbeat(status_path)
    control.start(heartbeat.beat)
    events.emit("hello", version=__version__)
    heartbeat.update("preparing")

    from .job.progress import Progress

    progress = Progress(events, heartbeat, not to_stdout and sys.stderr.isatty(), shares)
    run, useless = Session(progress, control, events), False
    try:
        yield run
    except (Cancelled, KeyboardInterrupt):
        run.code = CANCELLED
    except Exception as error:
        if isinstance(error, OSError) and error.errno in _REMEDIES and error.filename is None:
            error.filename = str(events_path.parent)  # a write that fails does not tell where
        run.code, message = explain(error)
        useless = isinstance(error, INPUT_ERRORS)
        with suppress(OSError):
            events.emit("error", code=run.code, message=message)
        raise
    finally:
        control.stop()
        progress.close()
        # A disk that is full hears nothing more; the parent still does.
        with suppress(OSError):
            heartbeat.update({DONE: "done", CANCELLED: "cancelled"}.get(run.code, "failed"))
        with suppress(OSError):
            events.emit("bye", exit_code=run.code)
        with suppress(OSError):
            events.close()
        if useless and begun is not None:
            begun.take_back((events_path, status_path, cancel_path))


@contextmanager
def passing_session(stage: str, text: str, to_stdout: bool) -> Iterator[Session]:
    """A session of one stage that keeps no files of its own, and tells itself that it was cancelled.

    Args:
        text: what is being done.
        to_stdout: as in `session`; then whoever started it speaks on stdin.
    """
    # On Windows a file that somebody looks at stays; that is no reason for the work to fail.
    with tempfile.TemporaryDirectory(prefix="nmf-", ignore_cleanup_errors=True) as folder:
        paths = (Path(folder) / name for name in ("events.jsonl", "status.json", "cancel"))
        with session(*paths, to_stdout, has_parent=to_stdout, shares={stage: 1.0}) as run:
            run.progress.stage(stage, text)
            yield run
        if run.code == CANCELLED:
            say("Cancelled.")


def explain(error: Exception) -> tuple[int, str]:
    """Exit code and one sentence for an error; FAILED for one that nobody foresaw."""
    if isinstance(error, INPUT_ERRORS):
        return BAD_INPUT, str(error)
    text = str(error).lower()
    windows = getattr(error, "winerror", None) in _NO_MEMORY_ON_WINDOWS
    if isinstance(error, MemoryError) or windows or _NO_MEMORY.search(text):
        return OUT_OF_MEMORY, "Out of memory: close other programs, use smaller photos, or choose draft."
    in_the_way = isinstance(error, (NotADirectoryError, FileExistsError)) and error.filename
    if in_the_way and not os.path.isdir(in_the_way):
        return BAD_INPUT, f"{in_the_way}: a file is in the way of a folder; give another path."
    if isinstance(error, OSError) and is_too_long(error):
        return BAD_INPUT, f"{error.filename}: the name is too long for this disk; give a shorter one."
    if isinstance(error, OSError) and error.errno in _REMEDIES:
        where = error.filename or "what was to be written"
        return BAD_INPUT, f"{where}: writing failed ({error.strerror}); {_REMEDIES[error.errno]}."
    if "no space left" in text or "i/o error" in text:
        return BAD_INPUT, f"The job folder cannot be written ({error}); free space or move the job."
    if isinstance(error, KNOWN_FAILURES):
        return FAILED, str(error)
    return FAILED, f"{type(error).__name__}: {error}"
