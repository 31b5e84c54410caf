"""The demo's pictures and numbers, from the renders that `demo.py` left.

    python samples/demo_report.py OUT [--seconds S]

Writes overview.png, relit_*.png, turntable.png, report.json and report.html into OUT. No Blender in here.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import subprocess
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from solver.asset.files import write_png  # noqa: E402
from solver.capture.photos import load_photos, read_exr  # noqa: E402
from solver.capture.read import read_capture  # noqa: E402
from solver.fit.preview import over_plain, tone_mapped  # noqa: E402
from solver.job.folder import JobFolder  # noqa: E402
from solver.metrics.image import psnr, ssim  # noqa: E402
from solver.metrics.normals import normal_mae  # noqa: E402
from solver.replacing import write_json_atomic  # noqa: E402
from solver.report import Row, write_report  # noqa: E402

RELIGHTS = ("sunset", "studio")
RELIT_ROWS = 2
SHOWN = "r_3"  # the held-out view of the overview
INTRO = (
    "Held-out photos beside Cycles renders of the reconstructed mesh, textures and light; then the same "
    "object under two lights it was not photographed in, beside renders of the original."
)


class Page:
    """Collects rows of pictures and lists of scores on the way through the renders."""

    def __init__(self, out: Path):
        self.out = out
        self.renders = out / "renders"
        self.rows: list[Row] = []
        self.scores: dict[str, list[float]] = {}

    def add_row(self, title: str, prefix: str, pictures: dict[str, np.ndarray]) -> None:
        """Save sRGB pictures, named by caption, as one row."""
        files = []
        for caption, pixels in pictures.items():
            file = f"pictures/{prefix}_{re.sub(r'[^a-z0-9]+', '_', caption.lower()).strip('_')}.png"
            write_png(self.out / file, pixels)
            files.append((caption, file))
        self.rows.append(Row(title, files))

    def score(self, name: str, value: float) -> float:
        """Keep a score under a name; the page shows the mean."""
        self.scores.setdefault(name, []).append(value)
        return value


def main(out: Path, seconds: float | None) -> int:
    """Write the report of a demo folder; `seconds` is the time of the whole demo, if known."""
    page = Page(out)
    cameras = page.renders / "held_out.json"
    capture = read_capture(cameras, trusted=True)  # written by the demo itself
    photos = load_photos(capture)
    strip(page)
    for camera, photo in zip(capture.cameras, photos, strict=True):
        held_out_row(page, camera, photo.pixels)
    for name in RELIGHTS:
        relit_rows(page, name, [camera.name for camera in capture.cameras], camera.image_path.parent)
    shown = photos[[c.name for c in capture.cameras].index(SHOWN)]
    write_png(out / "overview.png", overview(page, shown))
    numbers = {name: round(float(np.mean(values)), 3) for name, values in page.scores.items()}
    job = JobFolder.open(out / "job")
    solver = json.loads((job.result_dir / "report.json").read_text(encoding="utf-8"))
    numbers |= {
        "Optimiser steps": solver["steps"],
        "Triangles": solver["triangles"],
        "Minutes, reconstruction": round(solver["seconds"] / 60, 1),
        "Minutes, all": "in several goes" if seconds is None else round(seconds / 60, 1),
        "Preset, seed": f"{job.request.preset}, {job.request.seed}",
        "Machine": f"{os.cpu_count()} cores, {platform.machine()}, {platform.system()}",
        "Commit": commit(),
    }
    write_json_atomic(out / "report.json", numbers)
    write_report(out / "report.html", "Demo: the duck", INTRO, page.rows, numbers)
    print("\n".join(f"{name}: {value}" for name, value in numbers.items()))
    print(out / "report.html")
    return 0


def displayed(path: Path) -> np.ndarray:
    """An EXR render as sRGB pixels over white, in the steps of 8 bits as pictures are scored."""
    colour, alpha = read_exr(path)
    return np.round(over_plain(np.concatenate([colour, alpha[..., None]], axis=-1)) * 255) / 255


def overview(page: Page, photo) -> np.ndarray:
    """One view: the photo, the reconstruction in Cycles, and that under other lights."""
    views = [displayed(page.renders / name / f"{SHOWN}.exr") for name in ("cycles", *RELIGHTS)]
    return np.concatenate([over_plain(photo.pixels), *views], axis=1)


def strip(page: Page) -> None:
    """turntable.png: the frames side by side."""
    frames = [displayed(path) for path in sorted((page.renders / "turntable").glob("*.exr"))]
    write_png(page.out / "turntable.png", np.concatenate(frames, axis=1))
    page.rows.append(Row("In Cycles, under the recovered light", [("turntable", "turntable.png")]))


def held_out_row(page: Page, camera, photo_pixels: np.ndarray) -> None:
    """One held-out view: the photo, Cycles, the solver, and normals beside the true ones."""
    photo = over_plain(photo_pixels)
    cycles = displayed(page.renders / "cycles" / f"{camera.name}.exr")
    solver = displayed(page.renders / "solver" / f"{camera.name}_linear.exr")
    normal, _ = read_exr(page.renders / "solver" / f"{camera.name}_normal.exr")
    true_normal, _ = read_exr(camera.image_path.with_name(f"{camera.name}_normal.exr"))
    score = page.score("Cycles against held-out photos, PSNR in dB", psnr(cycles, photo))
    page.score("Cycles against held-out photos, SSIM", ssim(cycles, photo))
    page.score("Solver's own renders against held-out photos, PSNR in dB", psnr(solver, photo))
    page.score("Cycles against the solver's own renders, PSNR in dB", psnr(cycles, solver))
    error = normal_mae(normal, true_normal, photo_pixels[..., 3])
    page.score("Normals, mean angular error in degrees", error)
    page.add_row(
        f"Held-out view {camera.name}: Cycles {score:.1f} dB, normals {error:.1f}°", camera.name,
        {
            "photo": photo, "Cycles": cycles, "difference ×4": np.abs(cycles - photo) * 4,
            "solver": solver, "normals": normal * 0.5 + 0.5, "true normals": true_normal * 0.5 + 0.5,
        },
    )  # fmt: skip


def relit_rows(page: Page, name: str, views: list[str], test: Path) -> None:
    """relit_NAME.png, and rows of the original and the reconstruction under that light."""
    folder = page.renders / name
    write_png(page.out / f"relit_{name}.png", displayed(folder / "large.exr"))
    light, _ = read_exr(test.parent / f"relight_{name}.exr")
    pictures = {}
    scores = []
    for view in views:
        truth = displayed(test.parent / f"relight_{name}" / f"{view}_hdr.exr")
        relit = displayed(folder / f"{view}.exr")
        scores.append(page.score(f"Relit by '{name}', PSNR in dB, no scale fitted", psnr(relit, truth)))
        if len(pictures) < 2 * RELIT_ROWS:
            pictures |= {f"{view}: the original": truth, f"{view}: reconstructed": relit}
    title = f"Relit by '{name}': {np.mean(scores):.1f} dB"
    page.add_row(title, name, {**pictures, "light": tone_mapped(light)})


def commit() -> str:
    """The checkout's commit, if git knows."""
    command = ["git", "-C", str(ROOT), "rev-parse", "--short", "HEAD"]
    try:
        return subprocess.run(command, capture_output=True, text=True).stdout.strip() or "unknown"
    except OSError:
        return "unknown"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--seconds", type=float)
    options = parser.parse_args()
    sys.exit(main(options.out.absolute(), options.seconds))
