"""Quality over time: PSNR and normal error of held-out views against the CPU seconds of a fit.

    python benchmarks/curves.py --scenes scenes/suzanne scenes/ball [--until 0.25] [--set fit.steps=…]

Seconds are those of this process, all threads, from reading the photos on; starting Python, compiling
and scoring do not count. The schedule is that of the whole preset, of which `--until` is a part.
A scene is written as soon as it is measured; what the JSON holds already, of the same code, machine and
settings, is left alone. `--before` names the JSON of an earlier release, whose curves then stand beside.
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

from benchmarks.machine import commit, describe_machine  # noqa: E402
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
from solver.replacing import write_json_atomic  # noqa: E402

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


def page(curves: dict[str, dict], before: dict[str, dict], picture: str) -> str:
    """All curves as a Markdown page.

    Args:
        curves: by scene, 'about' and the 'rows' of a curve. before: of an earlier release, may be empty.
    """
    lines = ["# Benchmarks: quality over time", "", "Written by `benchmarks/curves.py`; do not edit.",
             *abouts(curves, ""), *abouts(before, "Before: "),
             f"{VIEWS} held-out views at {RAYS} rays a pixel.", "",
             f"![PSNR and normal error over CPU seconds]({picture})", ""]  # fmt: skip
    if before:
        lines += ["Dashed: before. What it took then and takes now to get as far as then:", "",
                  *comparison(curves, before), ""]  # fmt: skip
    lines += table(curves)
    if before:
        lines += ["", "Before:", "", *table(before)]
    return "\n".join(lines) + "\n"


def abouts(curves: dict[str, dict], label: str) -> list[str]:
    """How curves came about, a line each; which scenes a line is of, unless it is of all."""
    scenes: dict[str, list[str]] = {}
    for name, curve in curves.items():
        scenes.setdefault(curve["about"], []).append(name)
    return [
        f"{label}{about}" if len(scenes) == 1 else f"{label}{', '.join(names)}: {about}"
        for about, names in scenes.items()
    ]


def comparison(curves: dict[str, dict], before: dict[str, dict]) -> list[str]:
    """CPU seconds until a scene was as good as it got in the part of the fit that was measured before."""
    lines = [
        "| scene | PSNR dB | CPU s before | now | times fewer | "
        "normal MAE ° | CPU s before | now | times fewer |",
        "| --- |" + " ---: |" * 8,
    ]
    for name in (n for n in curves if n in before):
        cells = [name]
        for key, better in (("psnr", 1), ("normal_mae", -1)):
            then = [row for row in before[name]["rows"] if key in row]
            if not then:
                cells += ["–"] * 4
                continue
            best = max(then, key=lambda row: better * row[key])
            reached = [
                row["cpu"]
                for row in curves[name]["rows"]
                if better * row.get(key, -better * np.inf) >= better * best[key]
            ]
            cells += [f"{best[key]:.2f}", f"{best['cpu']:.1f}"]
            cells += [f"{reached[0]:.1f}", f"{best['cpu'] / reached[0]:.1f}"] if reached else ["–"] * 2
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def table(curves: dict[str, dict]) -> list[str]:
    """A line a mark of every scene."""
    lines = ["| scene | step | CPU s | wall s | PSNR dB | normal MAE ° |"]
    lines += ["| --- | ---: | ---: | ---: | ---: | ---: |"]
    for name, curve in curves.items():
        for row in curve["rows"]:
            angle = f"{row['normal_mae']:.2f}" if "normal_mae" in row else "–"
            lines.append(
                f"| {name} | {row['step']} | {row['cpu']:.1f} | {row['wall']:.1f} | "
                f"{row['psnr']:.2f} | {angle} |"
            )
    return lines


def read_curves(path: Path) -> tuple[dict[str, dict], dict[str, dict]]:
    """Curves by scene of a JSON file, and those of an earlier release in it; none if there is no file."""
    if not path.is_file():
        return {}, {}
    content = json.loads(path.read_text(encoding="utf-8"))
    if "about" in content:  # one for all, as it was once
        curves = content["curves"].items()
        return {name: {"about": content["about"], "rows": rows} for name, rows in curves}, {}
    return content["curves"], content["before"]


def write(curves: dict[str, dict], before: dict[str, dict], out: Path) -> None:
    """JSON, page and picture."""
    write_json_atomic(out.with_suffix(".json"), {"curves": curves, "before": before})
    picture = Path("images") / f"{out.name}.png"
    text = page(curves, before, picture.as_posix())
    out.with_suffix(".md").write_text(text, encoding="utf-8", newline="\n")

    def points(of: dict[str, dict], key: str) -> dict[str, list[tuple[float, float]]]:
        return {
            name: [(row["cpu"], row[key]) for row in curve["rows"] if key in row]
            for name, curve in of.items()
        }

    line_charts(
        out.parent / picture,
        [
            {"x": "CPU seconds", "y": label, "log_x": True, "lines": points(curves, key),
             "dashed": points({name: before[name] for name in curves if name in before}, key)}
            for label, key in (("PSNR dB", "psnr"), ("normal MAE °", "normal_mae"))
        ],
        columns=2,
    )  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scenes", nargs="+", type=Path, required=True)
    parser.add_argument("--preset", default="draft")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--until", type=float, default=1.0, help="fraction of the fit to run")
    parser.add_argument("--set", action="append", default=[], metavar="SECTION.FIELD=VALUE")
    parser.add_argument("--before", type=Path, help="the JSON of an earlier release")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "curves", help="without ending")
    options = parser.parse_args()
    settings = settings_for(options.preset, dict(text.split("=", 1) for text in options.set))
    steps = settings.fit.steps
    changes = "".join(f" `--set {text}`" for text in options.set)
    about = (
        f"Preset `{options.preset}`{changes}, the first {round(steps * options.until)} of its {steps} "
        f"steps, seed {options.seed}; {describe_machine()}."
    )
    curves, before = read_curves(options.out.with_suffix(".json"))
    if options.before is not None:
        before = read_curves(options.before)[0]
    for scene in (path.resolve() for path in options.scenes):
        # Nobody knows what changed files were like the last time.
        if curves.get(scene.name, {}).get("about") == about and not commit().endswith("+"):
            print(f"{scene.name}: already there", flush=True)
            continue
        rows = curve(scene, settings, options.seed, options.until)
        curves[scene.name] = {"about": about, "rows": rows}
        write(curves, before, options.out)
    write(curves, before, options.out)


if __name__ == "__main__":
    main()
