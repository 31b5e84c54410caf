"""`make demo`: reconstruct the sample capture, relight it in Cycles, and write a report.

    python samples/demo.py [OUT]          (a Python with the bpy wheel and the solver's packages)

Leaves in OUT (default `demo/`): asset.blend, relit_*.png, turntable.png, report.html, and the job.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import platform
import shutil
import subprocess
import sys
import time
from pathlib import Path

import bpy
import numpy as np
from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "samples")]

import reconstruct  # noqa: E402

from solver.capture.photos import load_photos, read_exr  # noqa: E402
from solver.capture.read import read_capture  # noqa: E402
from solver.fit.preview import over_white, save_png  # noqa: E402
from solver.metrics.image import psnr, ssim  # noqa: E402
from solver.report import Row, write_report  # noqa: E402

CAPTURE = ROOT / "samples" / "duck"
RELIGHTS = ("sunset", "studio")
HELD_OUT = (0, 3, 6, 9)
RELIT_VIEWS = (3, 6)
SAMPLES, TURNTABLE_SAMPLES, TURNTABLE_FRAMES = 64, 32, 8


def main() -> int:
    """Run the demo; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", nargs="?", type=Path, default=ROOT / "demo")
    parser.add_argument("--time-limit", type=float, help="seconds for the reconstruction")
    options = parser.parse_args()
    out = options.out.absolute()
    if out.exists():
        if not (out / "job" / "job.json").exists():
            print(f"{out}: the folder exists and is no earlier demo; remove it.", file=sys.stderr)
            return 2
        shutil.rmtree(out)
    started = time.monotonic()
    package = reconstruct.load_extension()

    def part(name: str):
        return importlib.import_module(f"{package.__name__}.{name}")

    command = ["reconstruct", str(CAPTURE), str(out / "asset.blend"), "--job", str(out / "job")]
    if options.time_limit:
        command += ["--time-limit", str(options.time_limit)]
    code = part("nmf_addon.headless").main(command)
    if code != 0:
        return code
    solved = time.monotonic()
    test = read_capture(CAPTURE, "test")
    photos = [over_white(photo.pixels) for photo in load_photos(test)]
    views = part("nmf_addon.scene.render_views")
    bpy.context.scene.cycles.use_denoising = True

    chosen = [test.cameras[i] for i in HELD_OUT]
    renders = pictures(views, chosen, out / "views", SAMPLES, "held-out views")
    rows, scores = compare(chosen, [photos[i] for i in HELD_OUT], renders, out)

    orbit = views.turntable(
        bpy.context, chosen[1], (0, 0, 0), out / "turntable", TURNTABLE_FRAMES, TURNTABLE_SAMPLES,
        progress=counter("turntable"),
    )  # fmt: skip
    strip = np.concatenate([displayed(path) for path in orbit], axis=1)
    save_png(strip, out / "turntable.png")
    rows.insert(0, Row("Turntable under the recovered light", [("", "turntable.png")]))

    for name in RELIGHTS:
        part("nmf_addon.scene.world").relight(bpy.context.scene, CAPTURE / f"relight_{name}.exr")
        cameras = [test.cameras[i] for i in RELIT_VIEWS]
        relit = pictures(views, cameras, out / f"relit_{name}", SAMPLES, f"relit: {name}")
        save_png(np.concatenate(relit, axis=1), out / f"relit_{name}.png")
        truth = [CAPTURE / f"relight_{name}" / f"r_{i}.png" for i in RELIT_VIEWS]
        rows.append(relit_row(name, cameras, relit, truth, out))
    numbers = {
        "PSNR of Cycles against held-out photos, dB": round(
            float(np.mean([s[0] for s in scores])), 2
        ),
        "SSIM of the same": round(float(np.mean([s[1] for s in scores])), 4),
        "PSNR of the solver's own renders, dB": solver_score(out / "job"),
        "Minutes, reconstruction": round((solved - started) / 60, 1),
        "Minutes, all": round((time.monotonic() - started) / 60, 1),
        "Machine": f"{os.cpu_count()} cores, {platform.machine()}, {platform.system()}",
        "Seed": 0,
        "Commit": commit(),
    }
    (out / "report.json").write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")
    write_report(
        out / "report.html", "Demo: the duck",
        "Held-out photos beside Cycles renders of the reconstructed mesh, textures and light, then "
        "the same object under two lights it was not photographed in, beside renders of the "
        "original.", rows, numbers,
    )  # fmt: skip
    print("\n".join(f"{name}: {value}" for name, value in numbers.items()))
    print(out / "report.html")
    return 0


def counter(what: str):
    """Progress lines with time left for a row of renders."""
    begun = time.monotonic()

    def show(done: int, count: int) -> None:
        left = (time.monotonic() - begun) / done * (count - done)
        print(f"{what}: {done} of {count}, {left:.0f} s left", file=sys.stderr, flush=True)

    return show


def pictures(views, cameras, folder: Path, samples: int, what: str) -> list[np.ndarray]:
    """Render cameras with Cycles; sRGB pictures over white."""
    files = views.render_cameras(
        bpy.context, list(cameras), folder, samples, progress=counter(what)
    )
    return [displayed(path) for path in files]


def displayed(path: Path) -> np.ndarray:
    """An EXR render as sRGB pixels over white."""
    colour, alpha = read_exr(path)
    return over_white(np.concatenate([colour, alpha[..., None]], axis=-1))


def compare(cameras, photos, renders, out: Path):
    """Rows photo | Cycles | difference, and (PSNR, SSIM) of each."""
    rows, scores = [], []
    for camera, photo, render in zip(cameras, photos, renders, strict=True):
        scores.append((psnr(render, photo), ssim(render, photo)))
        files = []
        for name, pixels in (
            ("photo", photo), ("Cycles", render), ("difference ×4", np.abs(render - photo) * 4),
        ):  # fmt: skip
            file = f"pictures/{camera.name}_{name.split()[0]}.png"
            save_png(pixels, out / file)
            files.append((name, file))
        rows.append(Row(f"Held-out view {camera.name}: {scores[-1][0]:.1f} dB", files))
    return rows, scores


def relit_row(name: str, cameras, relit, truth_files, out: Path) -> Row:
    """The relit object beside renders of the original under the same light."""
    files, scores = [], []
    for camera, pixels, truth_file in zip(cameras, relit, truth_files, strict=True):
        truth_pixels = np.asarray(Image.open(truth_file)).astype(np.float32) / 255
        alpha = truth_pixels[..., 3:]
        truth = truth_pixels[..., :3] * alpha + (1 - alpha)
        scores.append(psnr(pixels, truth))
        for kind, picture in (("original", truth), ("reconstruction", pixels)):
            file = f"pictures/{name}_{camera.name}_{kind}.png"
            save_png(picture, out / file)
            files.append((kind, file))
    return Row(f"Relit by '{name}': {np.mean(scores):.1f} dB, no scale fitted", files)


def solver_score(job: Path) -> float:
    """PSNR that the job's own report states."""
    numbers = json.loads((job / "result" / "report.json").read_text(encoding="utf-8"))
    return next(value for name, value in numbers.items() if name.startswith("PSNR"))


def commit() -> str:
    """The checkout's commit, if git knows."""
    result = subprocess.run(
        ["git", "-C", str(ROOT), "rev-parse", "--short", "HEAD"], capture_output=True, text=True
    )
    return result.stdout.strip() or "unknown"


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    sys.stderr.flush()
    # Blender's wheel tears down its GPU-less render devices in an order that can crash at exit.
    os._exit(code)
