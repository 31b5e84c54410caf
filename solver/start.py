"""Start the command line, or say which package this Python lacks."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from .interrupts import listen, stop_listening, was_interrupted
from .job.events import say
from .job.exit_codes import BAD_INPUT, CANCELLED

REQUIREMENTS = Path(__file__).with_name("requirements.txt")


def start() -> int:
    """Run the command that was asked for; returns the exit code."""
    listen()
    open_standard_streams()
    try:
        return _start()
    except KeyboardInterrupt:
        return _cancelled()
    except Exception:
        if was_interrupted():
            return _cancelled()
        raise
    finally:
        stop_listening()


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
            setattr(
                sys, name, open(number, "w" if number else "r", encoding="utf-8", closefd=False)
            )


def _start() -> int:
    try:
        from .cli import main

        return main()
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package == __package__ or not package:
            raise
        say(
            f"{sys.executable}: this Python lacks the package '{package}'; press Set Up Solver, or run: "
            f'"{sys.executable}" -m pip install -r "{REQUIREMENTS}"'
        )  # fmt: skip
        return BAD_INPUT


def _cancelled() -> int:
    say("Cancelled.")
    return CANCELLED
