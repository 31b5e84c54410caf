"""Standard streams as a process finds them: closed, lacking letters, or with nobody at the other end."""

import errno
import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TextIO


def open_standard_streams() -> None:
    """Let standard streams that a process was started without lead nowhere.

    Else the first files that are opened get their numbers, and what a library writes to number 2, an
    error's, goes into a file of the job's.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            nowhere = os.open(os.devnull, os.O_RDWR)
            if nowhere != number:
                os.dup2(nowhere, number)
                os.close(nowhere)
            setattr(sys, name, open(number, "w" if number else "r", encoding="utf-8", closefd=False))


def escape_missing_letters() -> None:
    """A path with letters that a console does not have must not end a run that is done."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def say(text: str) -> None:
    """Tell a person on stderr, if anybody listens there still."""
    with suppress(OSError, ValueError):
        print(text, file=sys.stderr, flush=True)


@contextmanager
def naming_stdout() -> Iterator[None]:
    """Let an error of what is printed in the body say where it was, for by itself it does not; if nobody
    reads, it is a `BrokenPipeError` on Windows, too."""
    try:
        yield
    except OSError as error:
        if error.errno == errno.EINVAL:
            error = BrokenPipeError(errno.EPIPE, error.strerror)
        error.filename = "standard output"
        raise error


def print_result(result: object) -> None:
    """Print what a command has done, also if whoever read it has gone, as `head` does.

    Raises:
        OSError: it cannot be written; it says that it was standard output.
    """
    with suppress(BrokenPipeError), naming_stdout():
        print(result, flush=True)


def flush_stdout() -> None:
    """Write what was printed; raises as `print_result`."""
    if sys.stdout is not None:
        with suppress(BrokenPipeError), naming_stdout():
            sys.stdout.flush()


def drop_unwritten() -> None:
    """Let what cannot be written go nowhere, so that Python's exit says no more of it."""
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def take_stdout_for_events() -> TextIO:
    """Reserve file descriptor 1 for events and send every other print to stderr.

    Call before libraries are imported that might print.
    """
    sys.stdout.flush()
    stream = os.fdopen(os.dup(1), "w", encoding="utf-8", newline="\n")
    os.dup2(2, 1)
    return stream


@contextmanager
def silent_stderr() -> Iterator[None]:
    """Without what native code writes to stderr: pycolmap 4.2's bundle adjustment turns its log on."""
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
