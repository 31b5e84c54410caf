"""What the panels draw, recorded by a layout that only listens."""

from __future__ import annotations

import json

import bpy
import killed
import pytest
from conftest import context_of_width
from drawing import Layout


def test_without_a_capture_the_first_step_is_to_import_one(draw):
    drawn, words = draw("capture")
    assert ("operator", "nmf.import_capture") in drawn and "transforms.json" in words and "COLMAP" in words
    assert not [item for item in drawn if item[0] == "prop"]


def test_a_capture_is_counted_and_gets_a_region_box(draw, capture):
    drawn, words = draw("capture")
    assert "3 photos with cameras" in words and ("operator", "nmf.select_region_box") in drawn
    bpy.data.objects.remove(next(i for i in capture.objects if i.name.endswith("Region")))
    drawn, _ = draw("capture")
    assert ("operator", "nmf.add_region_box") in drawn
    bpy.ops.nmf.add_region_box()
    drawn, _ = draw("capture")
    assert ("operator", "nmf.add_region_box") not in drawn
    assert ("operator", "nmf.select_region_box") in drawn


def test_a_photo_that_is_left_alone_is_counted_as_one(draw, capture):
    for item in [item for item in capture.objects if item.type == "CAMERA"][1:]:
        bpy.data.objects.remove(item)
    assert ("label", "1 photo with camera") in [item[:2] for item in draw("capture")[0]]


def test_what_a_check_found_is_shown_warnings_with_their_photo(draw, capture):
    finding = {"level": "warning", "photo": "IMG_3", "text": "it is blurred; leave it out"}
    more = [{"level": "note", "photo": None, "text": f"note {n}"} for n in range(9)]
    report = {"findings": [finding, *more], "estimate": {"text": "about 5 minutes"}}
    capture["nmf_findings"] = json.dumps(report)
    drawn, words = draw("capture")
    assert "IMG_3: it is" in words and "about 5 minutes" in words and "and 4 more" in words
    assert ("operator", "nmf.check_capture") in drawn and ("operator", "nmf.set_scale") in drawn


def test_a_box_that_masks_show_can_be_taken_by_a_button(draw, capture):
    drawn, _ = draw("capture")
    assert ("operator", "nmf.fit_region_box") not in drawn
    for box, offered in ((None, False), ({"min": [0, 0, 0], "max": [1, 1, 1]}, True)):
        capture["nmf_findings"] = json.dumps({"findings": [], "estimate": {}, "box": box})
        drawn, _ = draw("capture")
        assert (("operator", "nmf.fit_region_box") in drawn) == offered


@pytest.fixture
def not_set_up(extension, monkeypatch):
    monkeypatch.delenv("NMF_SOLVER_PYTHON")
    state = None, "The solver is not set up yet; press Set Up Solver."
    monkeypatch.setattr(extension("runtime"), "solver_state", lambda *_: state)


def test_a_solver_that_is_not_there_is_said_with_a_button(draw, not_set_up):
    drawn, words = draw("reconstruct")
    assert "not set up yet" in words and ("operator", "nmf.setup_solver") in drawn
    assert ("operator", "nmf.reconstruct") not in drawn


def test_where_the_variable_names_no_python_that_is_said_and_nothing_set_up_in_vain(
    draw, extension, monkeypatch
):
    monkeypatch.setenv("NMF_SOLVER_PYTHON", "/nowhere/python")
    extension("runtime").forget()
    drawn, words = draw("reconstruct")
    assert "correct it in the environment variable NMF_SOLVER_PYTHON" in words
    assert ("operator", "nmf.setup_solver") not in drawn
    assert ("operator", "nmf.reconstruct") not in drawn


def test_where_the_own_python_is_wrong_the_preferences_are_offered_and_no_set_up(
    draw, extension, monkeypatch
):
    monkeypatch.delenv("NMF_SOLVER_PYTHON")
    monkeypatch.setattr(extension("preferences"), "chosen", {"python": "/nowhere/python"}.get)
    extension("runtime").forget()
    drawn, words = draw("reconstruct")
    assert "does not exist" in words and ("operator", "preferences.addon_show") in drawn
    assert ("operator", "nmf.setup_solver") not in drawn


def test_the_set_up_shows_its_progress_and_its_error(draw, extension, not_set_up, monkeypatch):
    module = extension("setup_monitor")
    state = module.SetupState(running=True, fraction=0.4, text="Downloading torch (190 MB)")
    monkeypatch.setattr(module, "_state", state)
    drawn, _ = draw("reconstruct")
    assert ("progress", "Downloading torch (190 MB)", 0.4) in drawn
    assert ("operator", "nmf.cancel_setup") in drawn
    state.running, state.error = False, "ERROR: no space left on device"
    drawn, words = draw("reconstruct")
    assert "no space left" in words and ("operator", "nmf.copy_setup_log") in drawn


@pytest.fixture
def draw_setup(extension):
    """Draw the preferences' part about a solver that is set up; returns what it drew and its words."""

    def run(width=900):
        layout = Layout()
        extension("preferences").draw_setup(layout, context_of_width(width), again=True)
        return layout.drawn, " ".join(item[1] for item in layout.drawn if item[0] == "label")

    return run


def test_what_a_check_of_the_solver_found_stands_in_the_preferences(draw_setup, extension, monkeypatch):
    module = extension("setup_monitor")
    state = module.SetupState(is_check=True, log=["Cores 2", "CUDA not available"])
    monkeypatch.setattr(module, "_state", state)
    drawn, words = draw_setup()
    assert "Cores 2" in words and "CUDA not available" in words
    assert ("operator", "nmf.copy_setup_log") in drawn
    state.error = "No module named torch"
    assert "The solver does not start" in draw_setup()[1]


def test_in_a_narrow_sidebar_no_text_is_cut_off(
    draw, draw_setup, capture, extension, monitor, fake_solver, tick, monkeypatch
):
    narrow, most = 220, 24
    labels = lambda drawn: [item[1] for item in drawn if item[0] == "label"]  # noqa: E731
    module = extension("setup_monitor")
    text = "Downloading nvidia_cudnn_cu12 (190 MB of 2500 MB)"
    state = module.SetupState(running=True, fraction=0.4, text=text)
    monkeypatch.setattr(module, "_state", state)
    drawn, words = draw_setup(narrow)
    assert ("progress", "40 %", 0.4) in drawn and words == text
    assert max(map(len, labels(drawn))) <= most
    state.running, state.error = False, "ERROR: Could not install packages: no space left on device"
    drawn, words = draw_setup(narrow)
    assert state.error in words and max(map(len, labels(drawn))) <= most
    fake_solver("normal", pause=0.05)
    bpy.ops.nmf.reconstruct()
    monitor.model.text = extension("jobs.model").STAGE_TEXTS["compile"]
    drawn, words = draw("reconstruct", narrow)
    assert monitor.model.text in words and max(map(len, labels(drawn))) <= most
    tick()


def test_a_running_job_shows_stage_time_preview_and_cancel(
    draw, capture, monitor, fake_solver, tick, extension
):
    fake_solver("normal", pause=0.05)
    bpy.ops.nmf.reconstruct()
    tick(lambda: monitor.model.preview_version > 0)
    drawn, words = draw("reconstruct")
    assert "1:05 left" in words and "%" in words and "dB" in words
    assert extension("jobs.model").STAGE_TEXTS["fit"] in words
    assert ("operator", "nmf.cancel") in drawn and ("operator", "nmf.reconstruct") not in drawn
    icons = [item[1] for item in drawn if item[0] == "icon"]
    assert len(icons) == 3
    assert all(name in words for name in ("Photo", "Render", "Normals"))
    bpy.ops.nmf.cancel()
    assert "Cancelling" in draw("reconstruct")[1]
    tick()


def test_a_solver_without_news_is_told(draw, capture, monitor, fake_solver, tick, monkeypatch):
    fake_solver("silent")
    bpy.ops.nmf.reconstruct()
    process = monitor.process
    assert "No news" not in draw("reconstruct")[1]
    process._heard_at -= 75
    assert "No news for 1:1" in draw("reconstruct")[1]
    bpy.ops.nmf.cancel()
    tick()


def test_a_failure_offers_resume_and_report(draw, capture, monitor, fake_solver, tick):
    fake_solver("killed")
    bpy.ops.nmf.reconstruct()
    tick()
    drawn, words = draw("reconstruct")
    assert "crashed" in words and killed.WORDS in words
    assert ("operator", "nmf.resume") in drawn and ("operator", "nmf.copy_report") in drawn


def test_an_error_is_short_in_the_panel(extension):
    short = extension("panels").short_error
    log = "It ended with code 1.\nTraceback:\n  File x\n    y()\nValueError: no\n"
    assert short(log) == ["It ended with code 1.", "Traceback:", "ValueError: no"]
    assert short("one sentence") == ["one sentence"] and short("") == []
    assert len(short("\n".join("abcdefghij"))) == 3


def test_thumbnails_are_the_three_parts_of_the_preview(extension, tmp_path):
    import fake_capture
    import numpy as np

    thumbnails = extension("thumbnails")
    path = tmp_path / "render.png"
    colours = np.repeat(np.eye(3)[None].repeat(4, 0), 5, axis=1)
    fake_capture.write_pixels(path, colours)
    parts = thumbnails.read_parts(path, 3)
    for number, pixels in enumerate(parts):
        assert pixels.shape == (4, 5, 4)
        np.testing.assert_allclose(pixels[..., :3], np.broadcast_to(np.eye(3)[number], (4, 5, 3)))
    assert not bpy.data.images, "nothing stays in the file"
    thumbnails.show(path)
    assert [name for name, _ in thumbnails.icons()] == ["Photo", "Render", "Normals"]
    path.write_bytes(b"half a picture")
    thumbnails.show(path)
    assert thumbnails.icons() == []
