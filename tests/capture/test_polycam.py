"""Polycam's raw data: axes, folders, blurred photos, hostile files."""

import json

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from solver.capture.errors import CaptureError
from solver.capture.formats import polycam
from solver.capture.read import read_capture
from tests.capture.hostile import VALUES, reads_or_refuses


def camera_json(index, **changes):
    """A camera that stands at x = index, 1.5 m up, 2 m in front, and looks along −Z."""
    matrix = np.column_stack([np.eye(3), [index, 1.5, 2]])
    content = {f"t_{r}{c}": matrix[r, c] for r in range(3) for c in range(4)}
    content |= {"fx": 50.0, "fy": 51.0, "cx": 20.5, "cy": 14.5, "width": 40, "height": 30}
    content |= {"blur_score": 90.0, "timestamp": 123, "manual_keyframe": False}
    return content | changes


def make_polycam(folder, kind="corrected_", count=5, edit=None):
    cameras, images = (
        folder / "keyframes" / f"{kind}cameras",
        folder / "keyframes" / f"{kind}images",
    )
    for place in (cameras, images, folder / "keyframes" / "depth"):
        place.mkdir(parents=True)
    for i in range(count):
        content = camera_json(i)
        if edit is not None:
            edit(i, content)
        (cameras / f"{1000 + i}.json").write_text(json.dumps(content))
        Image.new("RGB", (40, 30), (i * 40, 0, 0)).save(images / f"{1000 + i}.jpg")
        Image.new("I;16", (10, 8)).save(folder / "keyframes" / "depth" / f"{1000 + i}.png")
    (folder / "mesh_info.json").write_text("{}")
    return folder


@pytest.mark.parametrize("kind", ["corrected_", ""])
@pytest.mark.parametrize("given_as", ["folder", "parent", "file"])
def test_the_folder_or_any_one_camera_stands_for_all(tmp_path, kind, given_as):
    folder = make_polycam(tmp_path / "scan" / "raw data", kind)
    path = {
        "folder": folder, "parent": folder.parent,
        "file": folder / "keyframes" / f"{kind}cameras" / "1003.json",
    }[given_as]  # fmt: skip
    capture = read_capture(path)
    assert [c.name for c in capture.cameras] == [str(1000 + i) for i in range(5)]
    assert all(c.image_path.parent.name == f"{kind}images" for c in capture.cameras)
    assert (capture.format, capture.metric, capture.up.tolist()) == ("Polycam", True, [0, 1, 0])
    assert not capture.warnings


def test_axes_and_lenses_are_taken_as_polycam_has_them(tmp_path):
    item = read_capture(make_polycam(tmp_path)).cameras[3]
    np.testing.assert_allclose(item.position, (3, 1.5, 2))
    np.testing.assert_allclose(item.view_direction, (0, 0, -1))
    pixel, depth = item.project(np.array([[3, 2.5, 0]]))  # a metre above the axis is up in the photo
    np.testing.assert_allclose(pixel[0], (20.5, 14.5 - 51 / 2))
    np.testing.assert_allclose(depth, 2)
    assert (item.fx, item.fy, item.width, item.height) == (50, 51, 40, 30)


def test_corrected_cameras_come_before_raw_ones(tmp_path):
    folder = make_polycam(tmp_path / "a", "")
    corrected = make_polycam(tmp_path / "b") / "keyframes"
    for name in ("corrected_cameras", "corrected_images"):
        (corrected / name).rename(folder / "keyframes" / name)
    capture = read_capture(folder)
    assert capture.source.parent.name == "corrected_cameras"
    assert {c.image_path.parent.name for c in capture.cameras} == {"corrected_images"}


def test_blurred_photos_are_left_out_with_a_warning_unless_most_are(tmp_path):
    def one(i, content):
        content["blur_score"] = 3.0 if i == 2 else 80.0

    capture = read_capture(make_polycam(tmp_path / "a", edit=one))
    assert [c.name for c in capture.cameras] == ["1000", "1001", "1003", "1004"]
    assert "1 photo that Polycam scores as blurred is left out" in capture.warnings[0]
    all_blurred = make_polycam(tmp_path / "b", edit=lambda i, content: content.update(blur_score=3.0))
    assert len(read_capture(all_blurred).cameras) == 5


def test_a_depth_map_never_stands_in_for_a_missing_photo(tmp_path):
    folder = make_polycam(tmp_path)
    (folder / "keyframes" / "corrected_images" / "1002.jpg").unlink()
    capture = read_capture(folder)
    assert len(capture.cameras) == 4 and "1002.jpg" in capture.warnings[0]


@pytest.mark.parametrize("key", ["t_12", "fx", "width"])
def test_what_a_camera_lacks_is_named_with_its_file(tmp_path, key):
    folder = make_polycam(tmp_path, edit=lambda i, content: content.pop(key) if i == 2 else None)
    with pytest.raises(CaptureError, match=f"1002.json, {key}: the camera lacks it"):
        read_capture(folder)


def test_a_camera_cut_in_half_is_named(tmp_path):
    folder = make_polycam(tmp_path)
    file = folder / "keyframes" / "corrected_cameras" / "1001.json"
    file.write_text(file.read_text()[:80])
    with pytest.raises(CaptureError, match="1001.json.*not valid JSON"):
        read_capture(folder)


def test_what_macos_lays_beside_cameras_is_none(tmp_path):
    folder = make_polycam(tmp_path)
    cameras = folder / "keyframes" / "corrected_cameras"
    for file in sorted(cameras.iterdir()):
        (cameras / f"._{file.name}").write_bytes(b"\0\5\x16\7\0\2\0\0Mac OS X" + bytes(99))
    assert len(read_capture(folder).cameras) == 5
    assert len(read_capture(cameras / "1003.json").cameras) == 5


def test_other_json_is_not_taken_for_polycams(tmp_path):
    for text in ("", "{}", "[1, 2]", '{"frames": [], "fx": 1}', "\x00\x01", '"t_00" "fx"'):
        (tmp_path / "a.json").write_text(text)
        assert not polycam.recognises(tmp_path / "a.json")
    assert not polycam.recognises(tmp_path / "none.json")


@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(key=st.sampled_from([*camera_json(0)]), value=VALUES, keep=st.floats(0.3, 1.5))
def test_hostile_cameras_end_in_a_capture_or_an_error(tmp_path_factory, key, value, keep):
    folder = make_polycam(
        tmp_path_factory.mktemp("p"),
        count=4,
        edit=lambda i, c: c.update({key: value}) if i == 1 else None,
    )
    file = folder / "keyframes" / "corrected_cameras" / "1001.json"
    file.write_text(file.read_text()[: int(keep * len(file.read_text()))])
    reads_or_refuses(folder)
