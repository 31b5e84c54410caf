"""Ctrl-C, whenever it comes, ends the command line as what it is: a cancel."""

from __future__ import annotations

import atexit
import os
import signal
import sys
import threading
from contextlib import suppress
from types import FrameType

from .job.exit_codes import CANCELLED

_interrupted = False


def listen() -> None:
    """Remember Ctrl-C from now on; it is a `KeyboardInterrupt`, as ever, unless a shell had it ignored.

    Who asks `was_interrupted` is told the truth where Python is not: an extension module that is
    interrupted while it loads raises an `ImportError`, and a class statement that Python makes from text
    (a dataclass, a named tuple) marks the process as killed by the signal, whatever catches it later
    (https://github.com/python/cpython/pull/11862).
    """
    in_main_thread = threading.current_thread() is threading.main_thread()
    if in_main_thread and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _remember)
        atexit.register(_end)  # before all others, so it is called after them


def was_interrupted() -> bool:
    """Whether Ctrl-C was pressed since `listen`."""
    return _interrupted


def stop_listening() -> None:
    """The work is over: Ctrl-C changes nothing about how it ended."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _remember(number: int, frame: FrameType | None) -> None:
    global _interrupted
    _interrupted = True
    raise KeyboardInterrupt


def _end() -> None:
    if _interrupted:
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):  # who read it may be gone by the same Ctrl-C
                stream.flush()
        os._exit(CANCELLED)
