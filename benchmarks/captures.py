"""From other programs' cameras to an asset: docs/captures.md.

    python benchmarks/captures.py --scene DIR [--programs COLMAP Metashape …] [--real DIR …]

A scene (a capture with a test split) is reconstructed as it is and as a project of every program: in
another world, its photos under other names, without any setting. Held-out views are scored in that world.
Real captures have no test split: every eighth photo is held out. Rows that the JSON holds are kept.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from benchmarks.machine import commit, describe_machine  # noqa: E402
from benchmarks.projects import WRITERS, write_project  # noqa: E402
from solver.capture.capture import Capture  # noqa: E402
from solver.capture.formats.transforms import write_transforms  # noqa: E402
from solver.capture.placement import placed  # noqa: E402
from solver.capture.read import read_capture  # noqa: E402
from solver.replacing import write_json_atomic  # noqa: E402

AS_IT_IS = "transforms.json"
PROGRAMS = [AS_IT_IS, *WRITERS]
HOLD_OUT = 8


def main() -> None:
    options = _options()
    results = options.out.with_suffix(".json")
    rows = json.loads(results.read_text(encoding="utf-8")) if results.is_file() else []

    def done(name: str, program: str) -> bool:
        return any((row["capture"], row["program"]) == (name, program) for row in rows)

    def keep(row: dict) -> None:
        rows.append(row)
        write_json_atomic(results, rows)
        options.out.with_suffix(".md").write_text(page(rows), encoding="utf-8")

    for scene in [options.scene] if options.scene else []:
        for program in options.programs:
            if not done(scene.name, program):
                keep(run_scene(scene, program, options.work / f"{scene.name}-{program}"))
    for capture in options.real:
        if not done(capture.name, AS_IT_IS):
            keep(run_real(capture, options.work / capture.name))
    print(options.out.with_suffix(".md"))


def run_scene(scene: Path, program: str, work: Path) -> dict:
    """Reconstruct a scene as a program would have exported it, and score its test split."""
    train, test = read_capture(scene), read_capture(scene, "test")
    source, matrix = scene, np.eye(4)
    if program != AS_IT_IS:
        source = work / "project"
        matrix = write_project(program, train, source, seed=PROGRAMS.index(program))
    return {"capture": scene.name, "program": program, **score(source, None, placed(test, matrix), work)}


def run_real(folder: Path, work: Path) -> dict:
    """Reconstruct a capture but every eighth photo, and score those."""
    capture = read_capture(folder)
    kept = [c for i, c in enumerate(capture.cameras) if i % HOLD_OUT]
    held_out = [c for i, c in enumerate(capture.cameras) if i % HOLD_OUT == 0]
    cameras = work / "capture" / "transforms_train.json"
    write_transforms(cameras, kept)
    test = replace(capture, cameras=tuple(held_out))
    return {"capture": folder.name, "program": AS_IT_IS, **score(cameras, folder, test, work)}


def score(source: Path, photos: Path | None, test: Capture, work: Path) -> dict:
    """Reconstruct with the command line and evaluate held-out cameras with it."""
    job = work / "job"
    began = time.monotonic()
    command = ["reconstruct", source, "--out", job]
    command += ["--photos", photos] if photos else []
    command += ["--resume"] if (job / "job.json").is_file() else []
    _solver(*command)
    seconds = time.monotonic() - began
    cameras, metrics = work / "test.json", work / "metrics.json"
    write_transforms(cameras, list(test.cameras))
    folder = test.cameras[0].image_path.parent
    _solver("evaluate", job, "--cameras", cameras, "--photos", folder, "--out", metrics)
    mean = json.loads(metrics.read_text(encoding="utf-8"))["mean"]
    return {
        "photos": len(read_capture(source, photos=photos).cameras), "seconds": round(seconds, 1),
        "psnr": mean["psnr"], "ssim": mean["ssim"], "held_out": len(test.cameras),
        "commit": commit(), "machine": describe_machine(),
    }  # fmt: skip


def _solver(*words: object) -> None:
    subprocess.run([sys.executable, "-m", "solver", *map(str, words)], cwd=ROOT, check=True)


def page(rows: list[dict]) -> str:
    """The page, a row a reconstruction."""
    lines = [
        "# From other programs' cameras", "",
        "`python benchmarks/captures.py`: preset *draft*, no other setting. Projects hold a scene's "
        "cameras in another world, with its photos renamed and paths of another machine; views that were "
        "held out are scored in that world. Photos of real captures are as shot, with their room, without "
        "masks. Seconds are wall time beside other work.", "",
        "| capture | cameras from | photos | held out | PSNR dB | SSIM | seconds | commit |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]  # fmt: skip
    for row in rows:
        lines.append(
            f"| {row['capture']} | {row['program']} | {row['photos']} | {row['held_out']} | "
            f"{row['psnr']:.2f} | {row['ssim']:.3f} | {row['seconds']:.0f} | {row['commit']} |"
        )
    machines = sorted({row["machine"] for row in rows})
    return "\n".join([*lines, "", *(f"{machine}." for machine in machines), ""])


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scene", type=Path, help="a capture with a test split")
    parser.add_argument("--programs", nargs="*", default=PROGRAMS, choices=PROGRAMS)
    parser.add_argument("--real", type=Path, nargs="*", default=[], metavar="DIR")
    parser.add_argument("--work", type=Path, default=ROOT / "build" / "captures")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "captures", help="of .md and .json")
    return parser.parse_args()


if __name__ == "__main__":
    main()
