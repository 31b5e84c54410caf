"""`make demo`: reconstruct the sample capture, render it in Cycles, relight it, write a report.

    python samples/demo.py [OUT]          (a Python with the bpy wheel and the solver's packages)

Leaves in OUT (default `demo/`): asset.blend, relit_*.png, turntable.png, report.html; in OUT/job the
job folder, in OUT/renders the linear EXRs. Run again, it goes on where it was interrupted; a finished
demo is left alone. The pictures and numbers are made by `demo_report.py`, in a process without Blender.
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib
import os
import subprocess
import sys
import time
from pathlib import Path

import bpy

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "samples"))

import demo_views  # noqa: E402
import reconstruct  # noqa: E402

CAPTURE = ROOT / "samples" / "duck"
SOLVER_SECONDS = 330  # so that all of it ends within ten minutes on two cores
RELIGHTS = ("sunset", "studio")
HELD_OUT = (0, 3, 6, 9)  # those that have relit truth, too
SHOWN = 3  # the held-out view that turns and is relit in large
SAMPLES, TURNTABLE_FRAMES = 32, 8  # denoised


def main() -> int:
    """Run the demo; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", nargs="?", type=Path, default=ROOT / "demo")
    parser.add_argument("--time-limit", type=float, default=SOLVER_SECONDS, metavar="SECONDS")
    options = parser.parse_args()
    out = options.out.absolute()
    if (out / "report.html").exists():
        print(f"The demo is finished: {out / 'report.html'}. To run it again: make clean-demo demo")
        return 0
    unfinished = (out / "job" / "job.json").exists()
    if out.exists() and any(out.iterdir()) and not unfinished:
        print(f"{out}: there are files, but no demo; give another folder.", file=sys.stderr)
        return 2
    out.mkdir(parents=True, exist_ok=True)
    begun = time.monotonic()
    package = reconstruct.load_extension()

    say("1/5 reconstruct the duck from 60 photos: about five minutes")
    command = ["reconstruct", str(CAPTURE), str(out / "asset.blend"), "--job", str(out / "job")]
    command += ["--time-limit", str(options.time_limit), "--overwrite"]
    command += ["--resume"] if unfinished else []
    with blender_output_to(out / "blender.log"):
        code = importlib.import_module(f"{package.__name__}.nmf_addon.headless").main(command)
        if code != 0:
            say(f"The log is {out / 'job' / 'log.txt'}; make demo continues where this stopped.")
            return code
        cameras = held_out_cameras(package)
        render_all(package, cameras, out / "renders")
    say("5/5 the solver's own renders, for comparison")
    transforms = importlib.import_module(f"{package.__name__}.solver.capture.formats.transforms")
    transforms.write_transforms(out / "renders" / "held_out.json", list(cameras.values()))
    code = solver_renders(out / "job", out / "renders")
    report = [sys.executable, str(ROOT / "samples" / "demo_report.py"), str(out)]
    if not unfinished:
        report += [f"--seconds={time.monotonic() - begun:.0f}"]
    return code or subprocess.run(report, check=False).returncode


def held_out_cameras(package) -> dict[int, object]:
    """The test cameras that the demo shows, by number."""
    read = importlib.import_module(f"{package.__name__}.solver.capture.read")
    cameras = read.read_capture(CAPTURE, "test").cameras
    return {i: cameras[i] for i in HELD_OUT}


def render_all(package, cameras: dict, folder: Path) -> None:
    """Held-out views, a turntable, and the views relit, as linear EXRs under `folder`."""
    world = importlib.import_module(f"{package.__name__}.nmf_addon.scene.world")
    context = bpy.context
    context.scene.cycles.use_denoising = True
    shown = cameras[SHOWN]

    say("2/5 the held-out views in Cycles")
    demo_views.render_cameras(
        package, context, list(cameras.values()), folder / "cycles", SAMPLES, progress=counter()
    )
    say("3/5 a turntable")
    demo_views.turntable(
        package, context, enlarged(shown, 300), (0, 0, 0), folder / "turntable", TURNTABLE_FRAMES,
        SAMPLES, progress=counter(),
    )  # fmt: skip
    for name in RELIGHTS:
        say(f"4/5 relit: {name}")
        world.relight(context.scene, CAPTURE / f"relight_{name}.exr")
        shots = [*cameras.values(), dataclasses.replace(enlarged(shown, 400), name="large")]
        demo_views.render_cameras(package, context, shots, folder / name, SAMPLES, progress=counter())


def enlarged(camera, width: int):
    """The same view, `width` pixels wide."""
    factor = width / camera.width
    values = {name: factor * getattr(camera, name) for name in ("fx", "fy", "cx", "cy")}
    return dataclasses.replace(camera, width=width, height=round(factor * camera.height), **values)


def solver_renders(job: Path, folder: Path) -> int:
    """Render `folder`/held_out.json with the solver to `folder`/solver; returns its exit code."""
    out = folder / "solver"
    command = [sys.executable, "-m", "solver", "render", str(job)]
    command += ["--cameras", str(folder / "held_out.json"), "--out", str(out)]
    show, shown = counter(), 0
    with subprocess.Popen(command, cwd=ROOT) as process:
        while process.poll() is None:
            time.sleep(0.3)
            done = len(list(out.glob("*_roughness.exr")))  # the last file of a view
            if done > shown:
                shown = done
                show(done, len(HELD_OUT))
    return process.returncode


def counter():
    """A callback (done, count) that prints progress with the time left."""
    begun = time.monotonic()

    def show(done: int, count: int) -> None:
        left = round((time.monotonic() - begun) / done * (count - done))
        say(f"    {done} of {count}, {left // 60}:{left % 60:02d} left")

    return show


def say(text: str) -> None:
    """Print a line of progress."""
    print(text, file=sys.stderr, flush=True)


class blender_output_to:
    """Blender prints a line per render tile to stdout: into a file with them, for a while."""

    def __init__(self, path: Path):
        self._path = path

    def __enter__(self) -> None:
        sys.stdout.flush()
        self._console = os.dup(1)
        log = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        os.dup2(log, 1)
        os.close(log)

    def __exit__(self, *error) -> None:
        sys.stdout.flush()
        os.dup2(self._console, 1)
        os.close(self._console)


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    sys.stderr.flush()
    # Blender's wheel tears down its GPU-less render devices in an order that can crash at exit.
    os._exit(code)
