"""The scaling benchmark: its captures can be read, its page and its picture hold what was measured."""

import json

import pytest
from PIL import Image

from benchmarks.plots import line_charts
from benchmarks.scaling import USUAL, capture_of, milliseconds_a_step, page, points
from solver.capture.photos import load_photos
from solver.capture.read import read_capture
from tests.cli.command import DUCK


def test_a_copy_has_the_views_and_the_resolution_asked_for(tmp_path):
    capture = read_capture(capture_of(DUCK, tmp_path / "copy", 40, 5))
    assert len(capture.cameras) == 5
    assert all(photo.pixels.shape == (40, 40, 4) for photo in load_photos(capture))
    whole = read_capture(DUCK)
    scale = 40 / whole.cameras[0].width
    assert abs(capture.cameras[0].fx - scale * whole.cameras[0].fx) < 1e-6


def test_points_differ_from_the_usual_one_in_their_own_axis_only():
    for axis, found in points().items():
        assert USUAL in found
        assert all(USUAL | {axis: point[axis]} == point for point in found)


def test_the_page_and_the_picture_show_what_was_measured(tmp_path):
    row = USUAL | {"milliseconds": 81.4, "before": 3.25, "gigabytes": 1.234}
    text = page({"grid": [row]}, "About.", "images/x.png")
    assert f"| {USUAL['grid']} | 81 | 3.2 | 1.23 |" in text and "(images/x.png)" in text
    charts = [{"x": "grid", "y": "ms", "lines": {"a": [(1, 2), (2, 4)]}}] * 3
    line_charts(tmp_path / "images" / "x.png", charts, columns=2)
    with Image.open(tmp_path / "images" / "x.png") as picture:
        assert picture.width > picture.height / 2 > 50


def test_what_comes_before_a_step_is_no_part_of_it(tmp_path):
    at = {1: 100.0, 10: 101.0, 20: 101.5, 30: 102.0, 39: 102.45, 40: 109.0}
    events = [
        {"ev": "progress", "stage": "fit", "step": step, "steps": 40, "t": t} for step, t in at.items()
    ]
    text = "\n".join(map(json.dumps, [{"ev": "stage", "name": "fit", "t": 90.0}, *events]))
    (tmp_path / "events.jsonl").write_text(text + "\n")
    assert milliseconds_a_step(tmp_path) == pytest.approx(50)
