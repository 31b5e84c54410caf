"""The command `solve`: cameras from a folder of photos."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from .. import __version__
from ..capture.errors import CaptureError
from ..job.control import Control
from ..job.events import EventStream, take_stdout_for_events
from ..job.status import Heartbeat, process_is_alive, read_status
from .folder import CAMERA_MODELS, MATCHERS, SolveFolder, SolveRequest, photos_below

DONE, CANCELLED = 0, 3


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
    photos = options.photos.absolute()
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
    folder.cancel_path.unlink(missing_ok=True)
    stream = take_stdout_for_events() if events else None
    control = Control(folder.cancel_path)
    control.start()
    out = EventStream(folder.events_path, stream)
    heartbeat = Heartbeat(folder.status_path)
    out.emit("hello", version=__version__)
    heartbeat.update("preparing")

    from ..cli import explain
    from ..fit.progress import Progress
    from .solve import SHARES, SolveCancelled, Solver

    progress = Progress(out, heartbeat, not events and sys.stderr.isatty(), SHARES)
    try:
        solved = Solver(folder, request, progress, control).run()
    except (SolveCancelled, KeyboardInterrupt):
        progress.close()
        heartbeat.update("cancelled")
        out.emit("bye", exit_code=CANCELLED)
        print("Cancelled; the same command continues.", file=sys.stderr)
        return CANCELLED
    except Exception as error:
        code, message = explain(error)
        progress.close()
        out.emit("error", code=code, message=message)
        heartbeat.update("failed")
        out.emit("bye", exit_code=code)
        raise
    finally:
        control.stop()
    if solved.warning:
        out.emit("warning", text=solved.warning)
    out.emit(
        "result", file=folder.cameras_path.name, placed=solved.placed, photos=solved.photos,
        points=solved.points,
    )  # fmt: skip
    progress.close()
    heartbeat.update("done")
    out.emit("bye", exit_code=DONE)
    if not events:
        _tell(folder, Path(request.photos), solved)
    return DONE


def _tell(folder: SolveFolder, photos: Path, solved) -> None:
    if solved.warning:
        print(f"warning: {solved.warning}.", file=sys.stderr)
    print(
        f"{solved.placed} of {solved.photos} photos have a camera, {solved.points} sparse points."
    )
    if not folder.finds_photos_of(photos):
        print(f"Reconstruct with --photos {photos}, for the cameras lie elsewhere.")
    print(folder.cameras_path)
