"""Start the command line, or say which package this Python lacks."""

import sys
from pathlib import Path

from .interrupts import listen, stop_listening, was_interrupted
from .job.exit_codes import BAD_INPUT, CANCELLED
from .streams import open_standard_streams, say

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


def _start() -> int:
    try:
        from .cli import main

        return main()
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package == __package__ or not package:
            raise
        say(
            f"{sys.executable}: this Python lacks the package '{package}'; press Set Up Solver in Blender, "
            f'or run: "{sys.executable}" -m pip install -r "{REQUIREMENTS}"'
        )
        return BAD_INPUT


def _cancelled() -> int:
    say("Cancelled.")
    return CANCELLED
