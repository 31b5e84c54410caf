"""The demo's report, of renders as `demo.py` leaves them; these are the truth itself, so it must be pleased."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from solver.asset.files import write_exr
from solver.capture.formats.transforms import write_transforms
from solver.capture.photos import load_photo, read_exr
from solver.capture.read import read_capture
from solver.job.folder import JobFolder
from solver.job.request import JobRequest

SAMPLES = Path(__file__).parents[2] / "samples"
DUCK = SAMPLES / "duck"
SHOWN = (0, 3, 6, 9)  # as in demo.py


def write_rgba(path, pixels):
    path.parent.mkdir(parents=True, exist_ok=True)
    write_exr(path, {"RGBA": pixels.astype(np.float32)})


@pytest.fixture
def demo(tmp_path):
    cameras = [read_capture(DUCK, "test").cameras[i] for i in SHOWN]
    renders = tmp_path / "renders"
    for camera in cameras:
        photo = load_photo(camera).pixels
        write_rgba(renders / "cycles" / f"{camera.name}.exr", photo)
        write_rgba(renders / "solver" / f"{camera.name}_linear.exr", photo)
        write_rgba(renders / "turntable" / f"{camera.name}.exr", photo)
        shutil.copy(camera.image_path.with_name(f"{camera.name}_normal.exr"), renders / "solver")
        for light in ("sunset", "studio"):
            truth = DUCK / f"relight_{light}" / f"{camera.name}_hdr.exr"
            colour, alpha = read_exr(truth)
            pixels = np.concatenate([colour, alpha[..., None]], axis=-1)
            write_rgba(renders / light / f"{camera.name}.exr", pixels)
            write_rgba(renders / light / "large.exr", pixels)
    write_transforms(renders / "held_out.json", cameras)
    job = JobFolder.create(tmp_path / "job", JobRequest(capture=str(DUCK)))
    job.result_dir.mkdir(parents=True)
    numbers = {"steps": 7, "triangles": 11, "seconds": 90.0}
    (job.result_dir / "report.json").write_text(json.dumps(numbers), encoding="utf-8")
    return tmp_path


def test_the_truth_gets_the_best_scores_and_every_picture_is_there(demo):
    command = [sys.executable, str(SAMPLES / "demo_report.py"), str(demo), "--seconds=120"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    numbers = json.loads((demo / "report.json").read_text(encoding="utf-8"))
    assert numbers["Cycles against held-out photos, PSNR in dB"] > 50
    assert numbers["Relit by 'sunset', PSNR in dB, no scale fitted"] > 50
    assert numbers["Normals, mean angular error in degrees"] == pytest.approx(0, abs=0.1)
    assert numbers["Minutes, all"] == 2 and numbers["Optimiser steps"] == 7
    width, height = Image.open(demo / "overview.png").size
    assert (width, height) == (4 * 200, 200)
    page = (demo / "report.html").read_text(encoding="utf-8")
    for picture in demo.rglob("pictures/*.png"):
        assert picture.name in page
    assert len(list(demo.rglob("pictures/*.png"))) >= 4 * 6
