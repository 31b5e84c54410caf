"""Fit a list of scenes with a list of settings; write docs/benchmarks.md and docs/benchmarks.json.

    python benchmarks/quality.py --scenes scenes/ball scenes/teapot=teapot --settings default "no neural"

A scene is a capture folder with a test split; `=NAME` says that it is the paper's scene NAME, whose
numbers then stand beside. Settings are 'default' and the rows of the paper's Table 1, or 'all'.
Rows that the JSON holds already are left alone, a fit that was interrupted is resumed.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from benchmarks.machine import commit, machine  # noqa: E402
from benchmarks.tables import write_page  # noqa: E402
from solver.fit.presets import PRESETS  # noqa: E402
from solver.job.events import read_events  # noqa: E402
from solver.replacing import write_json_atomic  # noqa: E402

# The paper's Table 1, row by row, as overrides of any preset.
ABLATIONS: dict[str, dict[str, object]] = {
    "no integral image": {"render.integral_image": False},
    "analytical derivative": {"field.smoothed_normals": False},
    "single bounce": {
        "render.retraced_rays": 0,
        "render.visibility": False,
        "render.diffuse_visibility": False,
    },
    "no neural": {"fit.neural_start": 0.0},
}
SETTINGS = {"default": {}, **ABLATIONS, "with neural": {"fit.neural_start": 1.0}}
# What is scored is the field. Pictures on the way, and an ablation's asset, only cost time.
NO_PREVIEWS = {"fit.preview_every": 1e9}
TOKEN_ASSET = {"asset.cells": 48, "asset.triangles": 500, "asset.texture_size": 64}


def main() -> None:
    options = _options()
    results = options.out.with_suffix(".json")
    rows = json.loads(results.read_text(encoding="utf-8"))["rows"] if results.is_file() else []
    changes = dict(text.split("=", 1) for text in options.set)
    for setting in options.settings:
        for text in options.scenes:
            path, _, paper_scene = text.partition("=")
            row = {
                "scene": Path(path).resolve().name, "setting": setting, "preset": options.preset,
                "seed": options.seed, "device": options.device, "changes": options.set,
            }  # fmt: skip
            if any(all(old.get(k) == v for k, v in row.items()) for old in rows):
                print(f"{row['scene']}, {setting}: already there", flush=True)
                continue
            job = options.work / job_name(row)
            row["paper_scene"] = paper_scene or None
            extra = NO_PREVIEWS if setting == "default" else NO_PREVIEWS | TOKEN_ASSET
            fit(row, Path(path), job, SETTINGS[setting] | extra | changes)
            if options.fit_only:
                continue
            row["quality"] = evaluate(Path(path), job)
            rows.append(row)
            write_json_atomic(results, {"rows": rows})
            write_page(rows, results.with_suffix(".md"))
    write_page(rows, results.with_suffix(".md"))
    print(results.with_suffix(".md"))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", nargs="+", required=True, metavar="FOLDER[=PAPER]")
    parser.add_argument("--settings", nargs="+", default=["all"], choices=["all", *SETTINGS])
    parser.add_argument("--preset", default="draft", choices=list(PRESETS))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--work", type=Path, default=ROOT / "build" / "benchmarks")
    parser.add_argument(
        "--out", type=Path, default=ROOT / "docs" / "benchmarks", help="of the .md and the .json"
    )
    parser.add_argument(
        "--set", action="append", default=[], metavar="section.field=value", help="for every row"
    )
    parser.add_argument("--fit-only", action="store_true", help="evaluate in a later run")
    options = parser.parse_args()
    if "all" in options.settings:
        options.settings = list(SETTINGS)
    return options


def job_name(row: dict) -> str:
    """A folder name for a row's job."""
    parts = [row["scene"], row["setting"], row["preset"], row["seed"], row["device"]]
    if row["changes"]:
        parts.append(hashlib.sha256(" ".join(row["changes"]).encode()).hexdigest()[:8])
    return "-".join(str(part) for part in parts).replace(" ", "_")


def fit(row: dict, scene: Path, job: Path, overrides: dict) -> None:
    """Reconstruct; adds seconds, stages, memory, machine and commit to the row."""
    measured = job / "benchmark.json"
    before = json.loads(measured.read_text()) if measured.is_file() else {}
    if not (job / "result" / "manifest.json").is_file() or not before:
        command = [sys.executable, "-m", "solver", "reconstruct", str(scene), "--out", str(job)]
        command += ["--preset", row["preset"], "--seed", str(row["seed"])]
        command += ["--device", row["device"]]
        command += ["--resume"] if (job / "job.json").is_file() else []
        for key, value in overrides.items():
            command += ["--set", f"{key}={value}"]
        print(f"{row['scene']}, {row['setting']}: fitting", flush=True)
        began = time.monotonic()
        process = subprocess.Popen(command, cwd=ROOT)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        before = {
            "seconds": before.get("seconds", 0) + time.monotonic() - began,
            "cpu_seconds": before.get("cpu_seconds", 0) + usage.ru_utime + usage.ru_stime,
            "peak_gigabytes": max(before.get("peak_gigabytes", 0), usage.ru_maxrss * _RSS_UNIT),
            "commit": commit(), **machine(),
        }  # fmt: skip
        if job.is_dir():
            write_json_atomic(measured, before)
        if process.returncode != 0:
            sys.exit(f"{row['scene']}, {row['setting']}: the fit ended with {process.returncode}")
    row.update(before, stages=stage_seconds(job))


def stage_seconds(job: Path) -> dict[str, float]:
    """Seconds by stage, from the job's events; those of a resumed job are added up."""
    seconds: dict[str, float] = {}
    current = None
    for event in read_events(job / "events.jsonl"):
        if event.kind == "hello":
            current = None
        if event.kind not in ("stage", "bye"):
            continue
        if current is not None:
            name, since = current
            seconds[name] = round(seconds.get(name, 0) + event.time - since, 1)
        current = (event.data["name"], event.time) if event.kind == "stage" else None
    return seconds


def evaluate(scene: Path, job: Path) -> dict:
    """`solver evaluate` on the scene's test split, once a job."""
    metrics = job / "metrics.json"
    if not metrics.is_file():
        print(f"{job.name}: evaluating", flush=True)
        command = [sys.executable, "-m", "solver", "evaluate", str(job), "--out", str(metrics)]
        command += ["--cameras", str(scene / "transforms_test.json")]
        subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    content = json.loads(metrics.read_text(encoding="utf-8"))
    for relit in content.get("relight", {}).values():
        relit.pop("views", None)
    return {key: value for key, value in content.items() if key not in ("views", "cameras")}


_RSS_UNIT = 1e-9 if sys.platform == "darwin" else 1024e-9

if __name__ == "__main__":
    main()
