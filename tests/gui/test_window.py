"""The panel in a real Blender's window, used with the mouse, with a stand-in for the solver."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
REAL_BLENDER = os.environ.get("NMF_REAL_BLENDER", "")
sys.path.insert(0, str(ROOT / "tests" / "blender"))

import fake_capture  # noqa: E402

pytestmark = [
    pytest.mark.real_blender,
    pytest.mark.skipif(
        not Path(REAL_BLENDER).is_file(),
        reason="no real Blender: NMF_REAL_BLENDER is not the path of real-blender.sh",
    ),
]


def _phone_capture(folder):
    names = [f"IMG_{number}.HEIC" for number in range(3)]
    folder.mkdir()
    for name in names:
        shutil.copy(ROOT / "tests" / "capture" / "data" / "heif" / "plain.heic", folder / name)
    return fake_capture.write_cameras(folder / "transforms_train.json", names)


def _video(folder):
    """The stand-in for the solver takes photos from any file."""
    folder.mkdir()
    (folder / "Walk.MOV").write_bytes(b"frames")
    return folder / "Walk.MOV"


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """What `window_steps.py` saw. Screenshots stay in NMF_GUI_OUT if that is set."""
    folder = tmp_path_factory.mktemp("window")
    out = Path(os.environ.get("NMF_GUI_OUT") or folder / "out")
    out.mkdir(parents=True, exist_ok=True)
    blender = ["bash", REAL_BLENDER, "--user", str(folder / "user")]
    build = ["--command", "extension", "build", "--source-dir", str(ROOT), "--output-dir"]
    environment = {
        **os.environ, "RB_BIND": f"{ROOT}:{out}", "NMF_GUI_OUT": str(out),
        "NMF_GUI_CAPTURE": str(fake_capture.write_capture(folder / "photos of it", 8, 64)),
        "NMF_GUI_PHONE_CAPTURE": str(_phone_capture(folder / "phone")),
        "NMF_GUI_VIDEO": str(_video(folder / "clips")), "NMF_SOLVER_PYTHON": "/usr/bin/python3",
        "NMF_SOLVER_BOOTSTRAP": str(ROOT / "tests" / "blender" / "fake_solver.py"),
    }  # fmt: skip

    def run(*words, seconds=120):
        answer = subprocess.run(
            [*blender, *words], capture_output=True, text=True, errors="replace", env=environment,
            timeout=seconds, stdin=subprocess.DEVNULL,
        )  # fmt: skip
        assert answer.returncode == 0, answer.stdout[-3000:] + answer.stderr[-3000:]

    run("headless", "--", *build, str(folder))
    archive = str(next(folder.glob("*.zip")))
    run("extension", "--", "install-file", "--repo", "user_default", "--enable", archive)
    run("gui", str(HERE / "window_steps.py"), str(out / "8_preferences.png"), seconds=240)
    return json.loads((out / "report.json").read_text())


def test_photos_of_a_phone_are_shown_once_their_cameras_are_dropped_and_undo_takes_both_back(
    report,
):
    before = len(report["cameras_before"])
    assert len(report["phone_cameras"]) == before + 3 and report["phone_shown"]
    assert report["phone_after_undo"] == [before + 3, 0]
    assert report["phone_after_two"] == [before, 0]


def test_one_undo_takes_an_import_back(report):
    assert len(report["imported"]) > len(report["cameras_before"])
    assert report["after_import_undo"] == report["cameras_before"]
    assert report["imported_again"] == report["imported"]


def test_reconstruct_is_pressed_and_shows_progress_and_a_preview(report):
    assert report["started"] and report["previewed"]
    assert 0.3 < report["overall"] < 1


def test_the_result_is_installed_by_itself_and_one_undo_takes_it_back(report):
    assert report["done"] and len(report["installed"]) == 1
    assert report["world"].endswith("light")
    assert report["after_undo"] == []


def test_cancel_and_resume_are_pressed(report):
    assert report["cancelled"] and report["state"] == "cancelled"
    assert report["resumed"]


def test_a_failure_shows_the_end_of_the_log(report):
    assert "ZeroDivisionError" in report["failure"]


def test_cameras_of_a_video_that_is_picked_in_the_file_browser_are_imported(report):
    assert report["video"] == "5 of 6 photos have a camera"
    assert report["video_capture"] == "Capture Walk_cameras"
    assert report["after_video_undo"]


def test_without_a_solver_the_panel_offers_to_set_it_up(report):
    assert report["setup_button"]
