"""The panel in a real Blender's window, used with the mouse, with a stand-in for the solver."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import fake_capture
import pytest

HEIF = Path(__file__).resolve().parents[1] / "capture" / "data" / "heif"


def _phone_capture(folder):
    names = [f"IMG_{number}.HEIC" for number in range(3)]
    folder.mkdir()
    for name in names:
        shutil.copy(HEIF / "plain.heic", folder / name)
    return fake_capture.write_cameras(folder / "transforms_train.json", names)


def _video(folder):
    """The stand-in for the solver takes photos from any file."""
    folder.mkdir()
    (folder / "Walk.MOV").write_bytes(b"frames")
    return folder / "Walk.MOV"


@pytest.fixture(scope="module")
def report(tmp_path_factory, screenshots, in_window):
    """What `window_steps.py` saw."""
    folder = tmp_path_factory.mktemp("window")
    in_window(
        "window_steps.py", "8_preferences.png",
        NMF_GUI_CAPTURE=str(fake_capture.write_capture(folder / "photos of it", 8, 64)),
        NMF_GUI_PHONE_CAPTURE=str(_phone_capture(folder / "phone")),
        NMF_GUI_VIDEO=str(_video(folder / "clips")),
    )  # fmt: skip
    return json.loads((screenshots / "report.json").read_text())


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


def test_the_region_box_is_selected_by_its_button(report):
    assert report["picked"] == ["Capture photos of it Region", 1]


def test_reconstruct_is_pressed_and_shows_progress_and_a_preview(report):
    assert report["started"] and report["previewed"]
    assert 0.3 < report["overall"] < 1


def test_the_result_is_installed_by_itself_and_one_undo_takes_it_back(report):
    assert report["done"] and len(report["installed"]) == 1
    assert report["world"].endswith("Light")
    assert report["after_undo"] == []


def test_cancel_and_resume_are_pressed(report):
    assert report["cancelled"] and report["state"] == "cancelled"
    assert report["resumed"]


@pytest.mark.parametrize(
    "meanwhile, what",
    [
        ("rendered", "the render or bake is over"),
        ("moved", "nothing is being moved"),
        ("duplicated", "nothing is being moved"),
    ],
)
def test_a_result_waits_until_the_person_is_done(report, meanwhile, what):
    assert report[meanwhile] == {
        "text": f"Done; the object will be added once {what}", "meanwhile": True, "after": 1
    }  # fmt: skip


def test_a_failure_shows_the_end_of_the_log(report):
    assert "ZeroDivisionError" in report["failure"]


def test_the_job_of_the_open_file_is_taken_up_when_the_extension_is_switched_on_again(report):
    assert report["enabled_again"] == "lost", "it died without a last word"


def test_cameras_of_a_video_that_is_picked_in_the_file_browser_are_imported(report):
    assert report["video"] == "5 of 6 photos have a camera"
    assert report["video_capture"] == "Capture Walk_cameras"
    assert report["after_video_undo"]


def test_without_a_solver_the_panel_offers_to_set_it_up(report):
    assert report["setup_button"]
