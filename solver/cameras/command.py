"""The commands `solve`, cameras from photos or from a video, and `frames`, photos from a video."""

import argparse
import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from ..arguments import add_command, add_events, add_ignore, add_seed
from ..capture.errors import CaptureError
from ..capture.ignored import check_given
from ..capture.photo_finder import PhotoFinder
from ..job.begun import Begun
from ..job.exit_codes import CANCELLED, DONE
from ..job.status import process_is_alive, read_status
from ..session import Session, passing_session, session
from ..streams import print_result, say
from .folder import (
    CAMERA_MODELS,
    FEWEST_PHOTOS,
    MATCHERS,
    MOST_VIDEO_PHOTOS,
    VIDEO_PHOTOS,
    SolveFolder,
    SolveRequest,
    check_of_video,
    is_video,
    photos_below,
)

MOST_SEED = (1 << 31) - 1
"""COLMAP's"""


def add_solve(commands: argparse._SubParsersAction) -> None:
    solve = add_command(commands, "solve", "find the cameras of photos or a video")
    solve.add_argument("photos", type=Path, help="folder of photos, their archive, or a video")
    solve.add_argument(
        "--out", type=Path, metavar="FOLDER",
        help="new, or of a solve to continue; default: PHOTOS/cameras, or 'VIDEO cameras' next to it",
    )  # fmt: skip
    solve.add_argument(
        "--video-photos", type=int, default=VIDEO_PHOTOS, metavar="N",
        help="photos to take from a video, each the sharpest frame of its part (default %(default)s)",
    )  # fmt: skip
    solve.add_argument(
        "--matcher", default="auto", choices=MATCHERS,
        help="pairs that are compared; sequential: photos were taken in order, like those of a video",
    )  # fmt: skip
    solve.add_argument(
        "--camera-model", default="OPENCV", choices=CAMERA_MODELS, metavar="MODEL",
        help="%(choices)s: a lens of COLMAP's (default %(default)s)",
    )  # fmt: skip
    sharing = solve.add_mutually_exclusive_group()
    sharing.add_argument("--single-camera", action="store_const", const="single", dest="sharing",
                         help="one lens for all (default: one for each size and focal length)")  # fmt: skip
    sharing.add_argument("--camera-per-photo", action="store_const", const="each", dest="sharing",
                         help="a lens for each photo, as after zooming or refocusing")  # fmt: skip
    solve.add_argument(
        "--masks", type=Path, metavar="DIR",
        help="use only what masks show, for an object turned in front of a still camera",
    )  # fmt: skip
    add_ignore(solve)
    add_seed(solve, MOST_SEED, 0)
    add_events(solve)
    solve.set_defaults(run=run_solve, sharing="auto")


def add_frames(commands: argparse._SubParsersAction) -> None:
    command = add_command(commands, "frames", "extract photos from a video")
    command.add_argument("video", type=Path, help="MP4, MOV and others")
    command.add_argument("--out", type=Path, required=True, metavar="DIR", help="new folder")
    command.add_argument(
        "--photos", type=int, default=VIDEO_PHOTOS, metavar="N",
        help="how many, each the sharpest frame of its part (default %(default)s)",
    )  # fmt: skip
    command.add_argument(
        "--span", type=int, nargs=2, metavar=("FIRST", "LAST"),
        help="only from these frames, counted from 0 by the video's clock; default: from all",
    )  # fmt: skip
    add_events(command)
    command.set_defaults(run=run_frames)


def run_frames(options: argparse.Namespace) -> int:
    """Write photos; returns the exit code.

    Raises:
        CaptureError: it is no video, the numbers cannot be, or the folder is there already.
    """
    from ..capture.video import check_video
    from .video_photos import take_photos

    video, folder = options.video, Path(os.path.abspath(options.out))
    _check_count(video, "photos", options.photos)
    check_video(video)
    if folder.exists():
        raise CaptureError(folder, "out", "it already exists", "give a new folder")
    span = None if options.span is None else range(options.span[0], options.span[1] + 1)
    with passing_session("video", "extracting photos from the video", options.events) as run:
        names = take_photos(video, folder, options.photos, run.told, span)
        run.events.emit("result", photos=list(names))
    if run.code == DONE and not options.events:
        print_result(f"{len(names)} photos in {folder}")
    return run.code


def run_solve(options: argparse.Namespace) -> int:
    """Solve, or continue a solve; returns the exit code. The last line on stdout is the camera file.

    Raises:
        CaptureError: no use of photos or folder, or no cameras in the photos.
    """
    # Without '..', as photos are told.
    photos = Path(os.path.abspath(options.photos))
    beside = photos.with_name(f"{photos.stem} cameras") if is_video(photos) else photos / "cameras"
    folder = SolveFolder(options.out or beside)
    check_given(None, options.masks, options.ignored)
    request = request_of(
        photos, folder, options.video_photos, matcher=options.matcher,
        camera_model=options.camera_model, sharing=options.sharing, seed=options.seed,
        masks=options.masks and str(options.masks.absolute()),
        ignored=options.ignored and os.path.abspath(options.ignored),
    )  # fmt: skip
    if process_is_alive(read_status(folder.status_path)):
        raise CaptureError(
            folder.root, "", "another process is solving cameras here", "cancel it, or wait for it"
        )
    begun = Begun.before(folder.request_path)
    folder.take(request)
    return _run(folder, request, options.events, begun)


def request_of(
    photos: Path, folder: SolveFolder, video_photos: int = VIDEO_PHOTOS, **others
) -> SolveRequest:
    """What is asked of a solve of a folder of photos, or of a video.

    Raises:
        CaptureError: no photos there, or too few, or in the folder of the solve; no video, or photos that
            cannot be taken from it, or have masks before they are.
    """
    masks, ignored = (
        None if others.get(name) is None else Path(others[name]) for name in ("masks", "ignored")
    )
    if not is_video(photos):
        if photos.is_relative_to(folder.root):
            raise CaptureError(folder.root, "out", "the photos are in this folder", "give a new folder")
        names = photos_below(photos, folder.root, masks, ignored)
        paths = [photos / name for name in names]
        finder = PhotoFinder(photos, masks, ignored=ignored)
        return SolveRequest(
            str(photos), names, _changed(paths),
            masks_changed=() if masks is None else _changed(map(finder.mask_of, paths)),
            ignored_changed=_changed(map(finder.ignored.of, paths)), **others,
        )  # fmt: skip
    from ..capture.video import check_video

    check_of_video(photos, masks, ignored)
    _check_count(photos, "video-photos", video_photos)
    check_video(photos)
    return SolveRequest(
        str(photos), (), _changed([photos]), ignored_changed=_changed([ignored]),
        video_photos=video_photos, **others,
    )  # fmt: skip


def _changed(files: Iterable[Path | None]) -> tuple[int | None, ...]:
    """When files were last written, nanoseconds; None where there is none, () if there are none at all."""
    times = tuple(None if file is None else file.stat().st_mtime_ns for file in files)
    return times if any(time is not None for time in times) else ()


def _check_count(video: Path, option: str, count: int) -> None:
    if not FEWEST_PHOTOS <= count <= MOST_VIDEO_PHOTOS:
        raise CaptureError(
            video, option, f"so many photos cannot be taken from it: {count}",
            f"ask for {FEWEST_PHOTOS} to {MOST_VIDEO_PHOTOS}",
        )  # fmt: skip


def _run(folder: SolveFolder, request: SolveRequest, events: bool, begun: Begun | None) -> int:
    from .solve import SHARES, SHARES_OF_VIDEO, Solver

    paths = folder.events_path, folder.status_path, folder.cancel_path
    shares = SHARES_OF_VIDEO if request.video_photos else SHARES
    with session(*paths, events, has_parent=events, shares=shares, begun=begun) as run:
        if request.video_photos:
            request = _with_photos(folder, request, run)
        solved = Solver(folder, request, run.progress, run.control).run()
        if solved.warning:
            run.progress.warning(solved.warning)
        run.events.emit(
            "result", file=folder.cameras_path.name, placed=solved.placed, photos=solved.photos,
            points=solved.points,
        )  # fmt: skip
    if run.code == CANCELLED:
        say("Cancelled; run the same command to continue.")
    elif not events:
        _tell(folder, request, solved)
    return run.code


def _with_photos(folder: SolveFolder, request: SolveRequest, run: Session) -> SolveRequest:
    """The request of a video as one of the photos that are taken from it."""
    from .video_photos import take_photos

    run.progress.stage("video", "extracting photos from the video")
    names = take_photos(Path(request.photos), folder.video_photos_dir, request.video_photos, run.told)
    matcher = "sequential" if request.matcher == "auto" else request.matcher
    return replace(request, photos=str(folder.video_photos_dir), names=names, matcher=matcher)


def _tell(folder: SolveFolder, request: SolveRequest, solved) -> None:
    print_result(f"{solved.placed} of {solved.photos} photos have a camera, {solved.points} sparse points.")
    photos = Path(request.photos)
    elsewhere = [] if folder.finds_photos_of(photos) else [f"--photos {photos}"]
    if request.ignored is not None and not Path(request.ignored).is_relative_to(photos):
        elsewhere.append(f"--ignore {request.ignored}")
    if elsewhere:
        told = " ".join(elsewhere)
        print_result(f"Reconstruct with {told}, since the camera file does not say where that is.")
    print_result(folder.cameras_path)
