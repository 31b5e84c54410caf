"""Time and memory of a fit against resolution, number of views, grid and cores; docs/scaling.md.

    python benchmarks/scaling.py --scene scenes/suzanne [--steps 200]

Every point is a `reconstruct` of its own, with few steps and a token asset, that differs from the first in
one thing. Photos of another resolution are resized: what is in them makes no difference here.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from PIL import Image  # noqa: E402

from benchmarks.machine import describe_machine  # noqa: E402
from benchmarks.plots import line_charts  # noqa: E402
from benchmarks.quality import NO_PREVIEWS, TOKEN_ASSET, fit  # noqa: E402
from solver.job.events import read_events  # noqa: E402

RESOLUTIONS, VIEWS, GRIDS = (100, 200, 400, 800), (15, 30, 60), (96, 128, 192, 256)
USUAL = {"resolution": 200, "views": 60, "grid": 128, "cores": os.cpu_count() or 1}


def capture_of(scene: Path, folder: Path, resolution: int, views: int) -> Path:
    """A copy of a NeRF-synthetic scene's training split with fewer views of another resolution."""
    listed = json.loads((scene / "transforms_train.json").read_text(encoding="utf-8"))
    listed["frames"] = listed["frames"][:: max(len(listed["frames"]) // views, 1)][:views]
    for key in ("w", "h"):
        if key in listed:
            listed[key] = resolution
    (folder / "train").mkdir(parents=True)
    for index, frame in enumerate(listed["frames"]):
        with Image.open((scene / frame["file_path"]).with_suffix(".png")) as photo:
            resized = photo.resize((resolution, resolution), Image.Resampling.BICUBIC)
        frame["file_path"] = f"./train/r_{index}"
        resized.save(folder / "train" / f"r_{index}.png")
    text = json.dumps(listed)
    (folder / "transforms_train.json").write_text(text, encoding="utf-8")
    return folder


def measure(scene: Path, folder: Path, point: dict, steps: int, preset: str) -> dict:
    """Milliseconds a step, seconds before the first one, peak memory in GB, of one point."""
    capture = capture_of(scene, folder / "capture", point["resolution"], point["views"])
    for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[name] = str(point["cores"])
    row = {"scene": scene.name, "setting": json.dumps(point), "preset": preset, "seed": 0, "device": "cpu"}
    sizes = {"field.sizes": str(point["grid"]), "field.size_starts": "0"}
    fit(row, capture, folder / "job", NO_PREVIEWS | TOKEN_ASSET | sizes | {"fit.steps": steps})
    stages = row["stages"]
    before = sum(stages.get(name, 0) for name in ("photos", "geometry"))
    return point | {
        "milliseconds": milliseconds_a_step(folder / "job"), "before": before,
        "gigabytes": row["peak_gigabytes"],
    }  # fmt: skip


def milliseconds_a_step(job: Path) -> float:
    """Time of a step in the second half of a job's fit, from its events: what comes before the first
    steps, and with the last, does not count."""
    events = read_events(job / "events.jsonl")
    of_fit = [e for e in events if e.kind == "progress" and e.data["stage"] == "fit"]
    half = [e for e in of_fit if 0 < e.data["steps"] / 2 <= e.data["step"] < e.data["steps"]]
    first, last = half[0], half[-1]
    return 1e3 * (last.time - first.time) / (last.data["step"] - first.data["step"])


def points() -> dict[str, list[dict]]:
    """The points of every axis; all axes share the usual one."""
    cores = sorted({1, 2, *(2**k for k in range(2, 8)), USUAL["cores"]})
    values = {
        "resolution": RESOLUTIONS, "views": VIEWS, "grid": GRIDS,
        "cores": [n for n in cores if n <= USUAL["cores"]],
    }  # fmt: skip
    return {axis: [USUAL | {axis: value} for value in found] for axis, found in values.items()}


def page(rows: dict[str, list[dict]], about: str, picture: str) -> str:
    """All axes as a Markdown page."""
    lines = [
        "# Benchmarks: scaling", "", "Written by `benchmarks/scaling.py`; do not edit.", about,
        "A step is one of the fit's second half; it takes as many rays whatever the photos are. Photos, "
        "masks and hull come before the first.", "",
        f"![Milliseconds a step, seconds before it and memory]({picture})",
    ]  # fmt: skip
    for axis, found in rows.items():
        lines += ["", f"| {axis} | ms a step | s before the first | peak GB |",
                  "| ---: | ---: | ---: | ---: |"]  # fmt: skip
        lines += [
            f"| {row[axis]} | {row['milliseconds']:.0f} | {row['before']:.1f} | {row['gigabytes']:.2f} |"
            for row in found
        ]
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scene", type=Path, required=True, help="in NeRF-synthetic's layout")
    parser.add_argument("--preset", default="draft")
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "scaling.md")
    options = parser.parse_args()
    # Fits with fewer cores change this process's environment, too.
    machine = describe_machine()
    measured: dict[str, dict] = {}
    rows = {}
    for axis, found in points().items():
        for point in found:
            key = json.dumps(point, sort_keys=True)
            if key not in measured:
                with tempfile.TemporaryDirectory() as folder:
                    measured[key] = measure(
                        options.scene.resolve(), Path(folder), point, options.steps, options.preset
                    )
                print(measured[key], flush=True)
        rows[axis] = [measured[json.dumps(point, sort_keys=True)] for point in found]
    usual = ", ".join(f"{name} {value}" for name, value in USUAL.items())
    about = (
        f"{options.scene.resolve().name}, preset `{options.preset}`, {options.steps} steps, seed 0; "
        f"where nothing else is said, {usual}. {machine}."
    )
    picture = Path("images") / f"{options.out.stem}.png"
    text = page(rows, about, picture.as_posix())
    options.out.write_text(text, encoding="utf-8", newline="\n")
    series = {"ms a step": "milliseconds", "s before the first": "before", "peak GB": "gigabytes"}
    line_charts(
        options.out.parent / picture,
        [
            {"x": axis, "y": label, "lines": {"": [(row[axis], row[key]) for row in found]}}
            for label, key in series.items()
            for axis, found in rows.items()
        ],
        columns=len(rows),
    )


if __name__ == "__main__":
    main()
