"""3D Scanner App's raw data: axes, frames without photos, hostile files."""

import json

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from solver.capture.errors import CaptureError
from solver.capture.formats import scanner_app
from solver.capture.read import read_capture
from tests.capture.hostile import VALUES, reads_or_refuses


def frame_json(index, **changes):
    """A camera that stands at x = index, 1.5 m up, 2 m in front, and looks along −Z."""
    pose = np.eye(4)
    pose[:3, 3] = index, 1.5, 2
    content = {
        "averageAngularVelocity": 0.06, "averageVelocity": 0.1, "exposureDuration": 0.0167,
        "frame_index": index, "motionQuality": 0.98, "time": 170.0 + index,
        "cameraPoseARFrame": pose.ravel().tolist(), "projectionMatrix": np.eye(4).ravel().tolist(),
        "intrinsics": [50.0, 0, 20.5, 0, 51.0, 14.5, 0, 0, 1],
    }  # fmt: skip
    return content | changes


def make_scan(folder, count=12, edit=None):
    """Each second frame has a photo, all have a depth map, as the app writes them."""
    folder.mkdir(parents=True)
    for i in range(count):
        content = frame_json(i)
        if edit is not None:
            edit(i, content)
        stem = f"frame_{i:05d}"
        (folder / f"{stem}.json").write_text(json.dumps(content))
        if i % 2 == 0:
            Image.new("RGB", (40, 30), (i * 20, 0, 0)).save(folder / f"{stem}.jpg")
        Image.new("I;16", (10, 8)).save(folder / f"depth_{i:05d}.png")
        Image.new("L", (10, 8)).save(folder / f"conf_{i:05d}.png")
    (folder / "info.json").write_text('{"device": "iPhone15,3"}')
    return folder


@pytest.mark.parametrize("given_as", ["folder", "parent", "file"])
def test_frames_with_photos_are_a_capture_and_others_are_not_missed(tmp_path, given_as):
    folder = make_scan(tmp_path / "scans" / "2024_05_01_14_47_59")
    path = {
        "folder": folder,
        "parent": folder.parent,
        "file": folder / "frame_00003.json",
    }[given_as]
    capture = read_capture(path)
    assert [camera.name for camera in capture.cameras] == [f"frame_{i:05d}" for i in range(0, 12, 2)]
    assert (capture.format, capture.metric) == ("3D Scanner App", True)
    assert capture.up.tolist() == [0, 1, 0] and not capture.warnings


def test_axes_and_lenses_are_arkits(tmp_path):
    item = read_capture(make_scan(tmp_path / "a")).cameras[3]
    assert (item.width, item.height, item.fx, item.fy) == (40, 30, 50, 51)
    pixels, depth = item.project(np.array([[6.0, 1.5, 0.0], [7.0, 2.5, 0.0]]))
    np.testing.assert_allclose(pixels, [(20.5, 14.5), (20.5 + 25, 14.5 - 25.5)])
    np.testing.assert_allclose(depth, 2)


def test_a_scan_without_photos_says_how_to_export_them(tmp_path):
    folder = make_scan(tmp_path / "a")
    for photo in folder.glob("*.jpg"):
        photo.unlink()
    with pytest.raises(CaptureError, match="no frame has a photo beside it; export 'All Data'"):
        read_capture(folder)


@pytest.mark.parametrize("field", ["cameraPoseARFrame", "intrinsics"])
def test_what_a_frame_states_wrongly_is_named_with_its_file(tmp_path, field):
    folder = make_scan(tmp_path / "a", edit=lambda i, c: c.update({field: [1.0] * 5}))
    with pytest.raises(CaptureError, match=rf"frame_00000.json.*{field}"):
        read_capture(folder)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(field=st.sampled_from(["cameraPoseARFrame", "intrinsics"]), value=VALUES, keep=st.floats(0.3, 1.5))
def test_hostile_frames_end_in_a_capture_or_an_error(tmp_path_factory, field, value, keep):
    folder = make_scan(
        tmp_path_factory.mktemp("s") / "a",
        count=8,
        edit=lambda i, c: c.update({field: value}) if i == 2 else None,
    )
    file = folder / "frame_00002.json"
    file.write_text(file.read_text()[: int(keep * len(file.read_text()))])
    reads_or_refuses(folder)


def test_other_json_is_not_taken_for_a_frame(tmp_path):
    for text in ("", "{}", "[1, 2]", '{"frames": [], "intrinsics": 1}', "\x00\x01"):
        (tmp_path / "a.json").write_text(text)
        assert not scanner_app.recognises(tmp_path / "a.json")
