"""The command `check`: look at a capture before hours are spent on it."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from ..job.exit_codes import DONE


def add_check(commands: argparse._SubParsersAction) -> None:
    """Add the command to the command line."""
    check = commands.add_parser("check", help="look for problems of a capture, in seconds")
    check.add_argument("capture", type=Path, help="folder, camera file, or a job")
    check.add_argument(
        "--photos", type=Path, metavar="DIR", help="if not below the capture's folder"
    )
    check.add_argument("--masks", type=Path, metavar="DIR", help="if not in a folder 'masks' there")
    check.add_argument("--preset", help="draft, standard or paper; default: the job's, or draft")
    check.add_argument("--json", action="store_true", help="one object on stdout, for programs")
    check.set_defaults(run=run_check)


def run_check(options: argparse.Namespace) -> int:
    """Print findings and estimate; the exit code is 0 also with warnings.

    Raises:
        CaptureError: the capture cannot be read. SettingsError: there is no such preset.
    """
    from ..capture.read import read_capture
    from ..fit.presets import settings_for
    from ..job.folder import JobFolder
    from ..job.inputs import capture_of, region_of
    from .check import check

    job = JobFolder.open(options.capture) if (options.capture / "job.json").is_file() else None
    preset = options.preset or ("draft" if job is None else job.request.preset)
    settings_for(preset)
    if job is None:
        capture = read_capture(options.capture, photos=options.photos, masks=options.masks)
        region = None
    else:
        capture, region = capture_of(job), region_of(job.request)
    report = check(capture, preset, _progress if sys.stderr.isatty() else None, region)
    if options.json:
        print(json.dumps(report.as_json(), allow_nan=False))
        return DONE
    for finding in report.findings:
        print(finding.line())
    if report.box is not None:
        low, high = (" ".join(f"{value:.6g}" for value in corner) for corner in report.box)
        print(f"box: masks show the object between {low} and {high}")
    print(report.estimate.line())
    return DONE


def _progress(done: int, count: int) -> None:
    end = "\n" if done == count else ""
    print(f"\rlooking at photo {done} of {count}", end=end, file=sys.stderr, flush=True)
