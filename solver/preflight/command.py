"""The commands `check`, to look at a capture before hours are spent on it, and `pictures`, to show it."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from ..arguments import add_capture, add_command, add_events
from ..job.exit_codes import DONE
from ..job.folder import JobFolder
from ..job.request import DEVICES
from ..session import passing_session
from ..streams import naming_stdout, print_result

if TYPE_CHECKING:
    import numpy as np

    from ..capture.capture import Capture
    from .check import Report

KINDS = "folder, camera file, archive, or a job"


def add_check(commands: argparse._SubParsersAction) -> None:
    check = add_command(commands, "check", "look for problems in a capture, in seconds")
    add_capture(check, KINDS)
    check.add_argument("--preset", help="draft, standard or paper; default: the job's, or draft")
    check.add_argument("--device", choices=DEVICES, help="device to run on; default: the job's, or auto")
    output = check.add_mutually_exclusive_group()
    output.add_argument("--json", action="store_true", help="one JSON object on stdout")
    add_events(output)
    check.set_defaults(run=run_check)


def add_pictures(commands: argparse._SubParsersAction) -> None:
    pictures = add_command(commands, "pictures", "make JPEGs of HEIC, AVIF and raw photos")
    add_capture(pictures, KINDS)
    pictures.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder for them, new or empty"
    )
    add_events(pictures)
    pictures.set_defaults(run=run_pictures)


def run_check(options: argparse.Namespace) -> int:
    """Tell findings and estimate; the exit code is 0 also with warnings.

    Raises:
        CaptureError: the capture cannot be read. SettingsError: there is no such preset or device.
    """
    from ..fit.presets import settings_for
    from .check import check

    job = _job_of(options)
    preset = options.preset or ("draft" if job is None else job.request.preset)
    overrides = {} if job is None else job.request.overrides
    settings_for(preset, overrides)
    capture, region = _capture_and_region(options, job)
    device = options.device or ("auto" if job is None else job.request.device)
    with passing_session("check", "looking at photos", options.events) as run:
        report = check(capture, preset, run.told, region, overrides, device)
        run.events.emit("result", report=report.as_json())
    if run.code == DONE and not options.events:
        with naming_stdout():
            if options.json:
                print(json.dumps(report.as_json(), allow_nan=False))
            else:
                _print(report, capture)
    return run.code


def _print(report: Report, capture: Capture) -> None:
    for finding in report.findings:
        print(finding.line())
    if report.box is not None:
        low, high = (" ".join(f"{value:.6g}" for value in corner) for corner in report.box)
        print(f"box: masks show the object between {low} and {high}")
    print(f"cameras: {len(capture.cameras)} of {capture.source} ({capture.format})")
    print(report.estimate.line())


def run_pictures(options: argparse.Namespace) -> int:
    """Write the copies; returns the exit code.

    Raises:
        CaptureError: the capture or one of its photos cannot be read, or the folder is in use.
    """
    from .pictures import write_pictures

    capture, _ = _capture_and_region(options, _job_of(options))
    with passing_session("pictures", "copying photos", options.events) as run:

        def tell(number: int, count: int) -> None:
            run.told(number / count, f"photo {number} of {count}")

        pictures = write_pictures(capture, options.out, tell)
        run.events.emit("result", pictures=pictures)
    if run.code == DONE and not options.events:
        print_result(f"{len(pictures)} pictures in {options.out}")
    return run.code


def _job_of(options: argparse.Namespace) -> JobFolder | None:
    return JobFolder.open(options.capture) if (options.capture / "job.json").is_file() else None


def _capture_and_region(
    options: argparse.Namespace, job: JobFolder | None
) -> tuple[Capture, np.ndarray | None]:
    from ..capture.read import read_capture
    from ..job.inputs import capture_of, region_of

    if job is not None:
        return capture_of(job), region_of(job.request)
    capture = read_capture(
        options.capture, photos=options.photos, masks=options.masks, ignored=options.ignored
    )
    return capture, None
