"""Turn photos of a shiny object into cameras, mesh, textures and light, and use the result.

Exit codes: 0 done, 2 bad input, 3 cancelled, 4 out of memory, 1 anything else.
"""

import argparse
import importlib
import math
import time
from pathlib import Path

from . import __version__
from .arguments import (
    add_capture,
    add_command,
    add_events,
    add_ignore,
    add_seed,
    add_settings,
    check_names,
    placement,
    seconds,
    unpack_archives,
    whole_number,
)
from .cameras.command import add_frames, add_solve
from .interrupts import work_is_done
from .job.begun import Begun
from .job.exit_codes import CANCELLED, DONE, FAILED
from .job.folder import JobFolder
from .job.request import DECODER, DEVICES, MOST_SEED, JobError, JobRequest, overrides_of
from .job.resume import take_up
from .job.status import process_is_alive, read_status
from .preflight.command import add_check, add_pictures
from .session import KNOWN_FAILURES, explain, session
from .streams import drop_unwritten, escape_missing_letters, flush_stdout, naming_stdout, print_result, say
from .threads import prepare_runtimes

MOST_RAYS = 1 << 16
"""secondary rays a pixel"""


def main(arguments: list[str] | None = None) -> int:
    """Run a command; returns the exit code."""
    escape_missing_letters()
    options = _parser().parse_args(arguments)
    options.began = time.monotonic()
    prepare_runtimes()
    try:
        check_names(options)
        unpack_archives(options)
        code = options.run(options)
        flush_stdout()
        return code
    except Exception as error:
        if isinstance(error, BrokenPipeError) and error.filename:
            return FAILED
        code, message = explain(error)
        if code == FAILED and not isinstance(error, KNOWN_FAILURES):
            raise
        say(message)
        return code
    finally:
        drop_unwritten()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m solver", description=__doc__.splitlines()[0])
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    add_solve(commands)
    add_frames(commands)
    add_check(commands)
    add_pictures(commands)
    new = add_command(commands, "reconstruct", "turn photos into mesh, textures and light")
    add_capture(new, "folder, camera file or archive")
    new.add_argument("--out", type=Path, required=True, metavar="JOB", help="new job folder")
    new.add_argument("--preset", help="draft (default), standard or paper")
    new.add_argument("--device", choices=DEVICES, help="device to run on; default: auto")
    add_seed(new, MOST_SEED, None)
    new.add_argument("--time-limit", type=seconds, metavar="SECONDS", help="for the whole job")
    new.add_argument(
        "--resume", action="store_true", help="continue the job in JOB; only its limit may change"
    )
    add_settings(new, "section.field=value", "change a setting (see docs/manual.md)")
    new.set_defaults(run=_reconstruct)

    run = add_command(commands, "run", "run or resume a job folder (how Blender starts it)")
    _add_job(run, "its folder")
    add_events(run)
    run.set_defaults(run=_run)

    render = add_command(commands, "render", "render a finished job from given cameras")
    _add_job(render)
    _add_views(render)
    render.set_defaults(run=_render)

    compose = add_command(commands, "compose", "render several jobs together under one light")
    compose.add_argument("jobs", type=Path, nargs="+", metavar="JOB", help="folders of finished jobs")
    compose.add_argument(
        "--place", action="append", default=[], type=placement, metavar="X,Y,Z[,SCALE[,DEGREES]]",
        help="where each job's world goes, in order: moved, scaled, turned about +Z",
    )  # fmt: skip
    _add_views(compose)
    compose.set_defaults(run=_compose)

    evaluate = add_command(commands, "evaluate", "compare renders with held-out photos")
    _add_job(evaluate)
    _add_cameras(evaluate, "camera file with photos, or an archive with both")
    evaluate.add_argument("--photos", type=Path, metavar="DIR", help="theirs, if not in its folder")
    add_ignore(evaluate)
    evaluate.add_argument(
        "--out", type=Path, metavar="FILE", help="file for the scores, such as metrics.json"
    )
    _add_rendering(evaluate)
    evaluate.set_defaults(run=_evaluate)

    export = add_command(commands, "export", "copy a job's asset files, or bake them again")
    _add_job(export)
    export.add_argument("--out", type=Path, metavar="DIR", help="new folder; default: JOB/export")
    add_settings(export, "asset.field=value", "bake again with another mesh or other textures")
    export.set_defaults(run=_export)

    purpose = "compile what the first fit would have to wait for"
    add_command(commands, "compile", purpose).set_defaults(run=_compile)
    add_command(commands, "doctor", "show what this machine can do").set_defaults(run=_doctor)
    return parser


def _add_job(command: argparse.ArgumentParser, purpose: str = "folder of a finished job") -> None:
    command.add_argument("job", type=Path, metavar="JOB", help=purpose)


def _add_cameras(command: argparse.ArgumentParser, purpose: str) -> None:
    command.add_argument("--cameras", type=Path, required=True, metavar="FILE", help=purpose)


def _add_views(command: argparse.ArgumentParser) -> None:
    _add_cameras(command, "camera file, or an archive with one")
    command.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the pictures")
    command.add_argument(
        "--environment", type=Path, metavar="LIGHT",
        help="another light: an equirectangular EXR, or another job",
    )  # fmt: skip
    _add_rendering(command)


def _add_rendering(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--rays", type=whole_number(1, MOST_RAYS), default=64, metavar="N",
        help="secondary rays per pixel (default %(default)s)",
    )  # fmt: skip
    command.add_argument(
        "--without-neural", action="store_const", const=0.0, dest="neural",
        help="leave the neural term out: what Cycles can show (draft and standard end so anyway)",
    )  # fmt: skip


def _reconstruct(options: argparse.Namespace) -> int:
    from .capture.read import read_capture
    from .fit.devices import choose_device
    from .fit.load import check_capture
    from .fit.presets import settings_for

    if options.resume and (options.out / "job.json").exists():
        job = JobFolder.open(options.out)
        asked = {
            "capture": str(options.capture.absolute()), "preset": options.preset,
            "device": options.device, "seed": options.seed, "photos": _absolute(options.photos),
            "masks": _absolute(options.masks), "ignored": _absolute(options.ignored),
            "overrides": _overrides(options.sets) or None,
        }  # fmt: skip
        take_up(job, asked, options.time_limit, check_capture)
        return _run_job(job, options.began)
    preset, overrides = options.preset or "draft", _overrides(options.sets)
    settings_for(preset, overrides)
    device = options.device or "auto"
    # Bad input is refused, and a package that is missing told, before a folder is made.
    read_capture(options.capture, photos=options.photos, masks=options.masks, ignored=options.ignored)
    importlib.import_module(".fit.reconstruct", __package__)
    choose_device(device)
    request = JobRequest(
        capture=str(options.capture.absolute()), preset=preset, device=device,
        seed=options.seed or 0, time_limit=options.time_limit, overrides=overrides,
        photos=_absolute(options.photos), masks=_absolute(options.masks),
        ignored=_absolute(options.ignored), code_version=__version__,
    )  # fmt: skip
    begun = Begun.before(JobFolder(options.out).request_path)
    return _run_job(JobFolder.create(options.out, request), options.began, begun=begun)


def _overrides(sets: list[str]) -> dict[str, str]:
    """As `overrides_of`; another job that they name is there."""
    overrides = overrides_of(sets)
    if overrides.get(DECODER):
        JobFolder.open(Path(overrides[DECODER]))
    return overrides


def _absolute(path: Path | None) -> str | None:
    return None if path is None else str(path.absolute())


def _run(options: argparse.Namespace) -> int:
    return _run_job(JobFolder.open(options.job), options.began, options.events, has_parent=True)


def _run_job(
    job: JobFolder, began: float, events: bool = False, has_parent: bool = False, begun: Begun | None = None
) -> int:
    """Run a job with its heartbeat, events and log; the last line on stdout is the manifest."""
    if process_is_alive(read_status(job.status_path)):
        raise JobError(f"{job.root}: another process is working on this job; cancel it first.")
    paths = job.events_path, job.status_path, job.cancel_path
    with session(*paths, events, has_parent, begun=begun) as run:
        from .fit.reconstruct import run_job

        manifest = run_job(job, run.progress, run.control, began)
        work_is_done()
        run.events.emit("result", file="result/manifest.json")
    if run.code == CANCELLED:
        say(f"Cancelled; continue with --resume ({job.root}).")
    elif not events:
        print_result(manifest)
    return run.code


def _render(options: argparse.Namespace) -> int:
    from .fit.render_job import render_job

    render_job(
        JobFolder.open(options.job), options.cameras, options.out, options.environment,
        options.rays, options.neural,
    )  # fmt: skip
    return DONE


def _compose(options: argparse.Namespace) -> int:
    from .fit.render_job import compose_jobs
    from .render.composition import Placement

    if len(options.place) > len(options.jobs):
        raise JobError("--place is given more often than JOB; leave some out.")
    places = options.place + [(0.0, 0.0, 0.0, 1.0, 0.0)] * (len(options.jobs) - len(options.place))
    placements = []
    for x, y, z, scale, degrees in places:
        placements.append(Placement((x, y, z), scale, math.radians(degrees)))
    compose_jobs(
        [JobFolder.open(job) for job in options.jobs], placements, options.cameras, options.out,
        options.environment, options.rays, options.neural,
    )  # fmt: skip
    return DONE


def _evaluate(options: argparse.Namespace) -> int:
    from .fit.evaluate import evaluate_job

    evaluate_job(
        JobFolder.open(options.job), options.cameras, options.out, options.rays, options.neural,
        options.photos, options.ignored,
    )  # fmt: skip
    return DONE


def _export(options: argparse.Namespace) -> int:
    from .asset.export import export_result

    job, overrides = JobFolder.open(options.job), overrides_of(options.sets)
    out = options.out or job.root / "export"
    if overrides:
        from .fit.bake_again import bake_again
        from .job.progress import plain_bar

        with plain_bar() as told:
            bake_again(job, out, overrides, told)
    else:
        export_result(job, out)
    print_result(out)
    return DONE


def _compile(options: argparse.Namespace) -> int:
    from .fit.devices import choose_device
    from .job.progress import plain_bar
    from .kernels.compile_ahead import compile_ahead

    with plain_bar() as told:
        for device in dict.fromkeys(("cpu", choose_device("auto"))):
            compile_ahead(device, lambda done: told(done, "compiling"))
    print_result("The solver's loops are compiled.")
    return DONE


def _doctor(options: argparse.Namespace) -> int:
    from .doctor import loading_errors, report

    with naming_stdout():
        print(report(), flush=True)
    errors = loading_errors()
    with naming_stdout():
        print("\n".join(errors or ["All packages load."]))
    return FAILED if errors else DONE
