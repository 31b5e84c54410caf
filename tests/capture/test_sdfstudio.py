"""SDFStudio's meta_data.json: its axes, masks, box, and hostile files."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from solver.capture.errors import CaptureError
from solver.capture.formats import sdfstudio, transforms
from solver.capture.read import read_capture, reader_of
from tests.capture.hostile import VALUES, reads_or_refuses
from tests.capture.programs import (
    COUNT,
    HEIGHT,
    RANDOM_TESTS,
    WIDTH,
    check_projection,
    names,
    poses,
    put,
    save_photos,
)

FX, FY, CX, CY = 80.0, 90.0, 49.5, 30.25


def scene(size=4):
    k = np.eye(size)
    k[0, 0], k[1, 1], k[0, 2], k[1, 2] = FX, FY, CX, CY
    return {
        "camera_model": "OPENCV", "height": HEIGHT, "width": WIDTH, "has_mono_prior": False, "pairs": None,
        "worldtogt": np.eye(4).tolist(), "has_foreground_mask": True,
        "scene_box": {"aabb": [[-1, -1, -0.5], [1, 1, 0.5]], "near": 0.5, "far": 4.5, "radius": 1.0,
                      "collider_type": "near_far"},
        "frames": [
            {"rgb_path": f"{name}.png", "camtoworld": pose.tolist(), "intrinsics": k.tolist(),
             "foreground_mask": f"{name}_foreground_mask.png"}
            for name, pose in zip(names(), poses(), strict=True)
        ],
    }  # fmt: skip


def write(folder, content):
    save_photos(folder)
    for name in names():
        Image.new("L", (WIDTH, HEIGHT), 255).save(folder / f"{name}_foreground_mask.png")
    (folder / "meta_data.json").write_text(json.dumps(content))
    return folder


@pytest.mark.parametrize("size", [3, 4])
def test_points_project_with_opencvs_axes_and_masks_and_box_are_read(tmp_path, size):
    capture = read_capture(write(tmp_path, scene(size)))
    assert capture.format == sdfstudio.NAME and not capture.warnings and capture.up is None

    def project(index, point):
        x, y, z = poses()[index, :3, :3].T @ (point - poses()[index, :3, 3])
        return FX * x / z + CX, FY * y / z + CY

    check_projection(capture, project, poses())
    assert [camera.mask_path.name for camera in capture.cameras] == [
        f"{name}_foreground_mask.png" for name in names()
    ]
    np.testing.assert_array_equal(capture.region, [(-1, -1, -0.5), (1, 1, 0.5)])


def test_it_is_recognised_by_its_content(tmp_path):
    write(tmp_path, scene())
    (tmp_path / "meta_data.json").rename(tmp_path / "transforms.json")
    assert reader_of(tmp_path / "transforms.json") is sdfstudio
    assert not transforms.recognises(tmp_path / "transforms.json")
    assert len(read_capture(tmp_path).cameras) == COUNT


@pytest.mark.parametrize(
    "at, value, field",
    [
        (("frames", 1, "rgb_path"), None, "frames[1].rgb_path"),
        (("frames", 1, "camtoworld"), [[1, 2], [3, 4]], "frames[1].camtoworld"),
        (("frames", 1, "intrinsics"), [[0.0] * 3] * 3, "frames[1].intrinsics"),
        (("frames", 1, "intrinsics"), "1 2 3", "frames[1].intrinsics"),
        (("frames",), {"a": 1}, "frames"),
        (("width",), "wide", "width"),
        (("scene_box", "aabb"), [[1, 1, 1], [-1, -1, -1]], "scene_box.aabb"),
    ],
)
def test_a_malformed_file_gets_an_error_with_file_field_and_remedy(tmp_path, at, value, field):
    content = scene()
    put(content, at, value)
    with pytest.raises(CaptureError) as caught:
        read_capture(write(tmp_path, content))
    assert caught.value.file.name == "meta_data.json" and caught.value.field == field
    assert caught.value.remedy


@RANDOM_TESTS
@given(
    at=st.sampled_from(
        [("frames", 1, "camtoworld"), ("frames", 1, "intrinsics"), ("frames", 1, "rgb_path"),
         ("frames", 1, "foreground_mask"), ("frames",), ("width",), ("scene_box",),
         ("scene_box", "aabb")]
    ),
    value=VALUES, keep=st.floats(0.3, 2),
)  # fmt: skip
def test_hostile_files_end_in_a_capture_or_an_error(tmp_path, at, value, keep):
    content = scene()
    put(content, at, value)
    file = write(tmp_path, content) / "meta_data.json"
    text = file.read_text()
    file.write_text(text[: int(keep * len(text))])
    reads_or_refuses(tmp_path)
