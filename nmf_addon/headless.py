"""Reconstruct without a window: `blender -c nmf`, `samples/reconstruct.py`, and the plain function.

Exit codes are the solver's: 0 done, 2 bad input, 3 cancelled, 4 out of memory, 1 anything else.
"""

import argparse
import shutil
import signal
import subprocess
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

import bpy

from ..solver.arguments import add_capture, add_seed, add_settings
from ..solver.capture.errors import CaptureError
from ..solver.job.events import Event, clock
from ..solver.job.exit_codes import BAD_INPUT, CANCELLED, DONE, FAILED
from ..solver.job.folder import JobFolder
from ..solver.job.inputs import capture_of
from ..solver.job.request import MOST_SEED, JobError, overrides_of
from ..solver.job.resume import take_up
from ..solver.streams import escape_missing_letters
from . import preferences
from .jobs.create import create_job, last_job_root, new_job_root
from .jobs.process import log_tail, run_blocking, start_job
from .reports import reason_of
from .runtime import RuntimeMissing, bootstrap_script, clean_environment
from .scene.archives import unpack_all
from .scene.capture_collection import photo_paths
from .scene.import_captures import import_capture
from .scene.install import InstalledAsset, install_result
from .scene.match_solver import check_cycles, match_photo, match_solver

MOST_PACKED = 200_000_000
"""bytes of photos that are packed into a .blend; if they have more, they stay where they are"""


class SolverFailed(RuntimeError):
    """The solver ended without a result; `code` is its exit code."""

    def __init__(self, code: int, message: str):
        super().__init__(message)
        self.code = code


def main(arguments: list[str]) -> int:
    """Run a command line (without the program's name); returns the exit code."""
    escape_missing_letters()
    for number in (signal.SIGINT, signal.SIGTERM):
        # Blender's own handler passes over the first and ends it at the second, with another code.
        signal.signal(number, signal.default_int_handler)
    options = _parser().parse_args(arguments)
    try:
        reconstruct_to_file(options)
    except (CaptureError, JobError, RuntimeMissing) as error:
        print(error, file=sys.stderr)
        return BAD_INPUT
    except SolverFailed as error:
        print(error, file=sys.stderr)
        return error.code if error.code < 1 << 31 else FAILED  # Windows' own, of a crash, are no exit codes
    except OSError as error:
        print(f"{error.filename or options.out}: {error.strerror}.", file=sys.stderr)
        return BAD_INPUT
    except RuntimeError as error:  # what Blender's operators raise
        print(error, file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        print("Cancelled.", file=sys.stderr)
        return CANCELLED
    print(options.out)
    return DONE


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="nmf", description="Turn photos and cameras into a .blend with a relightable object."
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    command = commands.add_parser("reconstruct", help="turn photos and cameras into a .blend")
    add_capture(command, "folder, camera file or archive")
    command.add_argument("out", type=Path, metavar="OUT.blend", help="new file")
    command.add_argument("--preset", help="draft (default), standard or paper")
    command.add_argument("--device", help="auto (default), cpu, cuda or mps")
    add_seed(command, MOST_SEED, None)
    command.add_argument("--time-limit", type=float, metavar="SECONDS", help="for the whole job")
    add_settings(command, "section.field=value", "change a setting (see docs/manual.md)")
    command.add_argument("--job", type=Path, help="job folder; default: beside OUT.blend")
    command.add_argument("--resume", action="store_true", help="continue the job in the job folder")
    command.add_argument("--overwrite", action="store_true", help="replace OUT.blend")
    return parser


def reconstruct_to_file(options: argparse.Namespace) -> InstalledAsset:
    """Import, reconstruct, install, match the solver's settings, pack and save.

    Raises:
        CaptureError, JobError, RuntimeMissing, SolverFailed.
        RuntimeError: OUT.blend cannot be saved; an older one is as it was.
    """
    out = options.out.absolute()
    if out.is_dir():
        raise JobError(f"{out}: this is a folder; give the name of a .blend.")
    if out.exists() and not options.overwrite:
        raise JobError(f"{out}: it already exists; give another name or --overwrite.")
    overrides = overrides_of(options.sets)
    python = preferences.solver_python()
    # Factory settings would switch off the installed extension, which this is.
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    check_cycles(bpy.context.scene)
    given = (options.capture, options.photos, options.masks, options.ignored)
    capture, photos, masks, ignored = unpack_all(
        bpy.context, [None if path is None else path.absolute() for path in given]
    )
    collection = import_capture(bpy.context, capture, photos, masks, ignored)
    bpy.context.scene.nmf.capture = collection
    check_writable(out.parent)
    name = f"{out.stem}_job"
    root = options.job.absolute() if options.job else last_job_root(name, out.parent)
    resumed = options.resume and root is not None and (root / "job.json").exists()
    if resumed:
        job = JobFolder.open(root)
        take_up_job(job, collection, options)
    else:
        root = options.job.absolute() if options.job else new_job_root(name, out.parent)
        was_there = root.exists()
        job = create_job(
            collection, root, preset=options.preset or "draft", device=options.device or "auto",
            seed=options.seed or 0, time_limit=options.time_limit,
            overrides=overrides,
        )  # fmt: skip
    if not job.is_complete():
        try:
            run_solver(python, job, ProgressLines())
        except SolverFailed as error:
            if error.code == BAD_INPUT and not resumed and not job.has_checkpoint():
                # Nothing came of it, and a corrected command may use the same folder.
                shutil.rmtree(job.root, ignore_errors=True)
                if was_there:
                    job.root.mkdir(exist_ok=True)
            raise
    asset = install_result(bpy.context, job.root, collection)
    left = match_solver(bpy.context.scene, asset.manifest.get("bounces", 2))
    if left:
        print(f"Warning: {left}", file=sys.stderr)
    match_photo(bpy.context.scene)
    pack_pictures(photo_paths(collection))
    save(out)
    return asset


def check_writable(folder: Path) -> None:
    """Make a folder and see that a file can be written there, before the solver works for minutes.

    Raises:
        JobError: none can.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise JobError(
            f"{folder}: it cannot be written to ({error.strerror}); give another folder."
        ) from error


def pack_pictures(photos: set[Path]) -> None:
    """Pack all pictures that are there into the open file; `photos` only if they do not make it huge."""
    large = sum(path.stat().st_size for path in photos if path.is_file())
    if large <= MOST_PACKED:
        photos = set()
    else:
        print(f"The photos ({large / 1e6:.0f} MB) are not packed; the file links to them.", file=sys.stderr)
    for image in bpy.data.images:
        if image.source != "FILE" or image.packed_file is not None:
            continue
        path = Path(bpy.path.abspath(image.filepath)).resolve()
        if path not in photos and path.is_file():
            image.pack()


def save(out: Path) -> None:
    """Save the open file.

    Raises:
        RuntimeError: it cannot be written whole; a file that was there is as it was.
    """
    try:
        # Not compressed: Blender does not notice when a compressed file is cut off by a full disk.
        bpy.ops.wm.save_as_mainfile(filepath=str(out), compress=False)
    except RuntimeError as error:
        reason = reason_of(error)
        raise RuntimeError(
            f"{out}: Blender could not save it ({reason}); make room, then run the same command "
            "with --resume."
        ) from error


def take_up_job(job: JobFolder, collection: bpy.types.Collection, options: argparse.Namespace) -> None:
    """Make sure that the job to be resumed is that of this capture and of these options.

    Raises:
        JobError: it was begun otherwise.
    """
    photos = {camera.image_path.name for camera in capture_of(job).cameras if camera.image_path}
    if photos != {path.name for path in photo_paths(collection)}:
        raise JobError(f"{job.root}: this job was made from other photos; give another --job.")
    asked = {
        "preset": options.preset, "device": options.device, "seed": options.seed,
        "overrides": overrides_of(options.sets) or None,
    }  # fmt: skip
    take_up(job, asked, options.time_limit)


def run_solver(python: Path, job: JobFolder, on_event) -> None:
    """Run the solver on a job and wait.

    Raises:
        SolverFailed: it ended without a result.
    """
    messages: list[str] = []

    def listen(event: Event) -> None:
        if event.kind == "error":
            messages.append(str(event.data.get("message", "")))
        on_event(event)

    process = start_job(python, bootstrap_script(), job, clean_environment())
    try:
        code = run_blocking(process, listen)
    except KeyboardInterrupt:
        process.close()
        with suppress(subprocess.TimeoutExpired):  # then it ends by itself a little later
            process.popen.wait(10)
        raise
    if code != 0:
        reason = " ".join(messages) or f"The solver ended with code {code}.\n{log_tail(job)}"
        raise SolverFailed(code if code > 0 else FAILED, reason)


class ProgressLines:
    """Prints a line whenever a stage begins or a twentieth of it is done."""

    def __init__(self) -> None:
        self._shown = ""

    def __call__(self, event: Event) -> None:
        data = event.data
        if event.kind == "warning":
            print(f"Warning: {data.get('text')}.", file=sys.stderr, flush=True)
        if event.kind != "progress":
            return
        left = data.get("seconds_left")
        share = int(20 * data.get("fraction", 0)) * 5
        line = f"{data.get('stage')}: {data.get('text')}, {share} %"
        if line == self._shown:
            return
        self._shown = line
        note = "" if left is None else f", {clock(left)} left"
        print(line + note, file=sys.stderr, flush=True)
