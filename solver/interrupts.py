"""Ctrl-C and SIGTERM, whenever they come, end the command line as what they are: a cancel."""

import atexit
import os
import signal
import sys
import threading
from contextlib import suppress
from types import FrameType

from .job.exit_codes import CANCELLED

_interrupted = False
_done = False


def listen() -> None:
    """Remember Ctrl-C and SIGTERM from now on; each is a `KeyboardInterrupt` unless a shell had it ignored.

    Who asks `was_interrupted` is told the truth where Python is not: an extension module that is
    interrupted while it loads raises an `ImportError`, and a class statement that Python makes from text
    (a dataclass, a named tuple) marks the process as killed by the signal, whatever catches it later
    (https://github.com/python/cpython/pull/11862).
    """
    if threading.current_thread() is not threading.main_thread():
        return
    as_ever = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
    heard = [number for number, handler in as_ever.items() if signal.getsignal(number) == handler]
    for number in heard:
        signal.signal(number, _remember)
    if heard:
        atexit.register(_end)  # before all others, so it is called after them


def was_interrupted() -> bool:
    """Whether Ctrl-C was pressed, or SIGTERM sent, since `listen`."""
    return _interrupted


def work_is_done() -> None:
    """What was asked for is there: from now on Ctrl-C and SIGTERM change nothing about how it ended."""
    global _done
    _done = True


def stop_listening() -> None:
    """The work is over: Ctrl-C changes nothing about how it ended, and SIGTERM is what it ever was."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        if signal.getsignal(signal.SIGTERM) == _remember:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _remember(number: int, frame: FrameType | None) -> None:
    global _interrupted
    if _done:
        return
    _interrupted = True
    if _is_loading(frame):
        with suppress(OSError):
            os.write(2, b"Cancelled.\n")
        os._exit(CANCELLED)
    raise KeyboardInterrupt


def _is_loading(frame: FrameType | None) -> bool:
    """Whether a module is being loaded, when nothing is at stake yet; some abort the process when they are
    interrupted (torch), or pass over it."""
    while frame is not None and not frame.f_code.co_filename.startswith("<frozen importlib"):
        frame = frame.f_back
    return frame is not None


def _end() -> None:
    if _interrupted:
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):  # who read it may be gone by the same Ctrl-C
                stream.flush()
        os._exit(CANCELLED)
