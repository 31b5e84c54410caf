"""Work in a process of its own: for libraries that may not share one with torch, and can be stopped so."""

import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

TURN = 0.2
"""seconds between two looks at whether to go on"""

PATIENCE = 5.0
"""seconds in which a process that has done its work may end by itself"""

PIECE = 1 << 20
"""bytes of a message; Windows does not take hundreds of megabytes, a capture's pictures, at once"""


class ApartError(RuntimeError):
    """The process ended without a result; one clause that says how."""


def run_apart(work: Callable[..., Any], *args: Any, progress: Callable[[float], None]) -> Any:
    """What `work(*args, progress)` returns, computed in a new process.

    Args:
        work: a module's function; it, its arguments and what it returns go through a pipe that only the
            two processes have. What is in files, a person's or a job's, is never unpickled.
        progress: told several times a second the share done that `work` told last; what it raises ends
            the process.

    Raises:
        ApartError: `work` raised an error, the process died, or none could be started.
    """
    # Not forked: a fork would have torch's threads' locks, without the threads.
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_work, args=(theirs,), daemon=True)
    try:
        process.start()
    except OSError as error:
        ours.close()
        raise ApartError(f"no process could be started: {error}") from error
    finally:
        theirs.close()
    told = 0.0
    try:
        while True:
            # Looked at first: what a process has sent before its end is still there.
            alive = process.is_alive()
            if ours.poll(TURN):
                kind, value = _received(ours)
                if kind == "ready":
                    # Not as the process's arguments, nor before it has the pipe: if it died until then,
                    # Python would wait for ever (it keeps the other end open itself).
                    _send(ours, (work, args))
                    continue
                if kind == "done":
                    process.join(PATIENCE)
                    return value
                if kind == "failed":
                    raise ApartError(value)
                told = value
            elif not alive:
                # On Windows Python itself may hold the pipe's other end, so that it never ends.
                raise EOFError
            progress(told)
    except (EOFError, ConnectionError):
        process.join()
        raise ApartError(f"the process ended with code {process.exitcode}") from None
    finally:
        process.kill()  # not terminated, of which libraries make a report
        process.join()
        ours.close()


def _work(pipe: Connection) -> None:
    # Ctrl-C, Ctrl-Break and a terminal's end reach all its processes; the parent decides what they mean.
    for name in ("SIGINT", "SIGBREAK", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _send(pipe, ("ready", None))
    try:
        work, args = _received(pipe)
        _send(pipe, ("done", work(*args, lambda done: _send(pipe, ("progress", done)))))
    except Exception as error:
        _send(pipe, ("failed", f"{type(error).__name__}: {error}"))


def _send(pipe: Connection, value: object) -> None:
    content = pickle.dumps(value)
    pipe.send_bytes(str(len(content)).encode())
    for start in range(0, len(content), PIECE):
        pipe.send_bytes(content[start : start + PIECE])


def _received(pipe: Connection) -> Any:
    length, content = int(pipe.recv_bytes()), bytearray()
    while len(content) < length:
        content += pipe.recv_bytes()
    return pickle.loads(content)


def _end_with_parent() -> None:
    """A parent that was killed ends nobody: what it started would go on, and hold its pipes and files."""
    multiprocessing.parent_process().join()
    os._exit(1)
