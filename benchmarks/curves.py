"""Quality over time: PSNR and normal error of held-out views against the CPU seconds of a fit.

    python benchmarks/curves.py --scenes scenes/suzanne scenes/ball [--until 0.25] [--set fit.steps=…]

Seconds are those of this process, all threads, from reading the photos on; starting Python, compiling
and scoring do not count. The schedule is that of the whole preset, of which `--until` is a part.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from solver.threads import prepare_runtimes  # noqa: E402

prepare_runtimes()

import numpy as np  # noqa: E402

from benchmarks.machine import describe_machine  # noqa: E402
from benchmarks.plots import line_charts  # noqa: E402
from solver.capture.photos import load_photos  # noqa: E402
from solver.capture.read import read_capture  # noqa: E402
from solver.fit.evaluate import true_normals  # noqa: E402
from solver.fit.presets import settings_for  # noqa: E402
from solver.fit.preview import display, over_plain  # noqa: E402
from solver.fit.schedule import picture_settings  # noqa: E402
from solver.fit.settings import Settings  # noqa: E402
from solver.fit.start import new_trainer  # noqa: E402
from solver.fit.trainer import Trainer  # noqa: E402
from solver.kernels.warm_up import compile_kernels  # noqa: E402
from solver.metrics.image import psnr  # noqa: E402
from solver.metrics.normals import normal_mae  # noqa: E402
from solver.render.image import render_view  # noqa: E402
from solver.render.scene import StepTables  # noqa: E402

VIEWS, RAYS = 5, 24
FIRST, FACTOR = 40, 1.5  # steps of the first mark, and from mark to mark


def curve(scene: Path, settings: Settings, seed: int, until: float) -> list[dict[str, float]]:
    """A row a mark: step, CPU seconds, wall seconds, PSNR and normal error of held-out views."""
    compile_kernels()
    cpu, wall = time.process_time(), time.monotonic()
    capture = read_capture(scene)
    photos = load_photos(capture)
    trainer = new_trainer(capture, photos, settings, seed, None, "cpu", lambda fraction: None)
    steps = settings.fit.steps
    marks = {round(FIRST * FACTOR**i) for i in range(40)} | {round(steps * until)}
    rows = []
    while trainer.step < round(steps * until):
        trainer.advance(trainer.step / steps)
        if trainer.step not in marks:
            continue
        row = {
            "step": trainer.step,
            "cpu": time.process_time() - cpu,
            "wall": time.monotonic() - wall,
        }
        before = time.process_time(), time.monotonic()
        rows.append(row | score(trainer, scene))
        cpu += time.process_time() - before[0]
        wall += time.monotonic() - before[1]
        print(scene.name, {key: round(value, 2) for key, value in rows[-1].items()}, flush=True)
    return rows


def score(trainer: Trainer, scene: Path) -> dict[str, float]:
    """Means over a few held-out views."""
    test = read_capture(scene, "test")
    chosen = np.linspace(0, len(test.cameras) - 1, VIEWS).astype(int)
    photos = load_photos(test)
    trainer.refresh_occupancy()
    tables = StepTables.of(trainer.scene)
    settings = picture_settings(trainer.settings, RAYS)
    values, angles = [], []
    for index in chosen:
        camera, photo = test.cameras[index], photos[index]
        view = render_view(trainer.scene, tables, settings, camera)
        values.append(psnr(display(view), over_plain(photo.pixels)))
        truth = true_normals(camera)
        if truth is not None:
            angles.append(normal_mae(view.normal, truth, photo.pixels[..., 3]))
    result = {"psnr": float(np.mean(values))}
    return result | ({"normal_mae": float(np.mean(angles))} if angles else {})


def page(curves: dict[str, list[dict[str, float]]], title: str, picture: str) -> str:
    """All curves as a Markdown page."""
    lines = ["# Benchmarks: quality over time", "", "Written by `benchmarks/curves.py`; do not edit.",
             f"{title} {VIEWS} held-out views at {RAYS} rays a pixel.", ""]  # fmt: skip
    lines += [f"![PSNR and normal error over CPU seconds]({picture})", ""]
    lines += ["| scene | step | CPU s | wall s | PSNR dB | normal MAE ° |"]
    lines += ["| --- | ---: | ---: | ---: | ---: | ---: |"]
    for name, rows in curves.items():
        for row in rows:
            angle = f"{row['normal_mae']:.2f}" if "normal_mae" in row else "–"
            lines.append(
                f"| {name} | {row['step']} | {row['cpu']:.1f} | {row['wall']:.1f} | "
                f"{row['psnr']:.2f} | {angle} |"
            )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scenes", nargs="+", type=Path, required=True)
    parser.add_argument("--preset", default="draft")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--until", type=float, default=1.0, help="fraction of the fit to run")
    parser.add_argument("--set", action="append", default=[], metavar="SECTION.FIELD=VALUE")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "curves", help="without ending")
    options = parser.parse_args()
    settings = settings_for(options.preset, dict(text.split("=", 1) for text in options.set))
    curves = {
        s.resolve().name: curve(s, settings, options.seed, options.until) for s in options.scenes
    }
    steps = settings.fit.steps
    title = (
        f"Preset `{options.preset}`, the first {round(steps * options.until)} of its {steps} steps, "
        f"seed {options.seed}; {describe_machine()}."
    )
    results = options.out.with_suffix(".json")
    old = json.loads(results.read_text(encoding="utf-8")) if results.is_file() else {}
    curves = old.get("curves", {}) | curves
    results.write_text(json.dumps({"about": title, "curves": curves}, indent=1), encoding="utf-8")
    picture = Path("images") / f"{options.out.name}.png"
    text = page(curves, title, picture.as_posix())
    options.out.with_suffix(".md").write_text(text, encoding="utf-8", newline="\n")
    line_charts(
        options.out.parent / picture,
        [
            {"x": "CPU seconds", "y": label, "log_x": True,
             "lines": {name: [(row["cpu"], row[key]) for row in rows if key in row]
                       for name, rows in curves.items()}}
            for label, key in (("PSNR dB", "psnr"), ("normal MAE °", "normal_mae"))
        ],
        columns=2,
    )  # fmt: skip


if __name__ == "__main__":
    main()
