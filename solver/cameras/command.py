"""The command `solve`: cameras from a folder of photos."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from ..capture.errors import CaptureError
from ..job.exit_codes import CANCELLED
from ..job.status import process_is_alive, read_status
from ..session import session
from .folder import CAMERA_MODELS, MATCHERS, SolveFolder, SolveRequest, photos_below


def add_solve(commands: argparse._SubParsersAction) -> None:
    """Add the command to the command line."""
    solve = commands.add_parser("solve", help="cameras from photos")
    solve.add_argument("photos", type=Path, help="folder of photos")
    solve.add_argument(
        "--out", type=Path, metavar="FOLDER",
        help="new, or of a solve to continue; default PHOTOS/cameras",
    )  # fmt: skip
    solve.add_argument(
        "--matcher", default="auto", choices=MATCHERS,
        help="sequential: photos are in the order of a walk or a film",
    )  # fmt: skip
    solve.add_argument("--camera-model", default="OPENCV", choices=CAMERA_MODELS)
    sharing = solve.add_mutually_exclusive_group()
    sharing.add_argument("--single-camera", action="store_const", const="single", dest="sharing",
                         help="one lens for all (default: one for each size and focal length)")  # fmt: skip
    sharing.add_argument("--camera-per-photo", action="store_const", const="each", dest="sharing")
    solve.add_argument(
        "--masks", type=Path, metavar="DIR",
        help="look only at what masks show: for an object that was turned before a still camera",
    )  # fmt: skip
    solve.add_argument("--seed", type=int, default=0)
    solve.add_argument("--events", action="store_true", help="events on stdout, no bar")
    solve.set_defaults(run=run_solve, sharing="auto")


def run_solve(options: argparse.Namespace) -> int:
    """Solve, or continue a solve; returns the exit code. The last line on stdout is the camera file.

    Raises:
        CaptureError: no use of photos or folder, or no cameras in the photos.
    """
    # Without '..', as photos are told.
    photos = Path(os.path.normpath(options.photos.absolute()))
    folder = SolveFolder(options.out or photos / "cameras")
    if options.masks is not None and not options.masks.is_dir():
        raise CaptureError(options.masks, "masks", "there is no such folder", "check its path")
    names = photos_below(photos, folder.root)
    request = SolveRequest(
        str(photos), names, tuple((photos / name).stat().st_mtime_ns for name in names),
        options.matcher, options.camera_model, options.sharing,
        None if options.masks is None else str(options.masks.absolute()), seed=options.seed,
    )  # fmt: skip
    if folder.root == photos:
        raise CaptureError(photos, "out", "this is the folder of the photos", "give a new folder")
    if process_is_alive(read_status(folder.status_path)):
        raise CaptureError(
            folder.root, "", "another process solves cameras here", "cancel it, or wait for it"
        )
    folder.take(request)
    return _run(folder, request, options.events)


def _run(folder: SolveFolder, request: SolveRequest, events: bool) -> int:
    from .solve import SHARES, Solver

    paths = folder.events_path, folder.status_path, folder.cancel_path
    with session(*paths, events, has_parent=events, shares=SHARES) as run:
        solved = Solver(folder, request, run.progress, run.control).run()
        if solved.warning:
            run.progress.warning(solved.warning)
        run.events.emit(
            "result", file=folder.cameras_path.name, placed=solved.placed, photos=solved.photos,
            points=solved.points,
        )  # fmt: skip
    if run.code == CANCELLED:
        print("Cancelled; the same command continues.", file=sys.stderr)
    elif not events:
        _tell(folder, Path(request.photos), solved)
    return run.code


def _tell(folder: SolveFolder, photos: Path, solved) -> None:
    print(
        f"{solved.placed} of {solved.photos} photos have a camera, {solved.points} sparse points."
    )
    if not folder.finds_photos_of(photos):
        print(f"Reconstruct with --photos {photos}, for the cameras lie elsewhere.")
    print(folder.cameras_path)
