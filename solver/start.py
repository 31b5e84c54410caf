"""Start the command line, or say which package this Python lacks."""

from __future__ import annotations

import sys
from pathlib import Path

from .job.exit_codes import BAD_INPUT

REQUIREMENTS = Path(__file__).with_name("requirements.txt")


def start() -> int:
    """Run the command that was asked for; returns the exit code."""
    try:
        from .cli import main

        return main()
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package == __package__ or not package:
            raise
        print(
            f"{sys.executable}: this Python lacks the package '{package}'; press Set Up Solver, or run: "
            f'"{sys.executable}" -m pip install -r "{REQUIREMENTS}"',
            file=sys.stderr,
        )  # fmt: skip
        return BAD_INPUT
