"""Record3D: poses, lenses of pictures of any size, layouts, hostile files."""

import json
import math

import numpy as np
import OpenEXR
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from solver.capture.errors import CaptureError
from solver.capture.formats import record3d
from solver.capture.read import read_capture
from tests.capture.hostile import VALUES, reads_or_refuses

HALF = math.sqrt(0.5)
POSES = [
    [0, 0, 0, 1, 0, 0, 0],
    [0, HALF, 0, HALF, 1, 2, 3],  # a quarter turn about +Y: the view goes from −Z to −X
    [HALF, 0, 0, HALF, 0, 0, 1],  # a quarter turn about +X: the view goes from −Z to +Y
    [0, 0.6, 0, 0.8, 0.5, 0, 0],
]
K = [60.0, 0, 0, 0, 61.0, 0, 14.5, 20.5, 1]  # column by column


def make_record3d(folder, layout="rgb", size=(30, 40), **changes):
    metadata = {"w": 30, "h": 40, "dw": 6, "dh": 8, "fps": 60, "K": K, "poses": POSES} | changes
    (folder / layout).mkdir(parents=True, exist_ok=True)
    name = "metadata.json" if layout == "rgb" else "metadata"
    (folder / name).write_text(json.dumps(metadata))
    (folder / "depth").mkdir(exist_ok=True)
    for i in range(len(POSES)):
        Image.new("RGB", size, (i * 40, 0, 0)).save(folder / layout / f"{i}.jpg")
    OpenEXR.File({}, {"R": np.ones((8, 6), np.float32)}).write(str(folder / "depth" / "2.exr"))
    return folder


@pytest.mark.parametrize("layout", ["rgb", "rgbd"])
def test_both_layouts_are_found_in_their_folder_and_above_it(tmp_path, layout):
    folder = make_record3d(tmp_path / "recordings" / "EXR_RGBD", layout)
    for path in (folder, folder.parent, next(folder.glob("metadata*"))):
        capture = read_capture(path)
        assert [c.image_path.name for c in capture.cameras] == ["0.jpg", "1.jpg", "2.jpg", "3.jpg"]
        assert (capture.format, capture.metric, capture.up.tolist()) == (
            "Record3D",
            True,
            [0, 1, 0],
        )


def test_poses_are_camera_to_world_with_the_quaternions_scalar_last(tmp_path):
    cameras = read_capture(make_record3d(tmp_path)).cameras
    np.testing.assert_allclose(cameras[0].camera_to_world, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(cameras[1].position, (1, 2, 3))
    np.testing.assert_allclose(cameras[1].view_direction, (-1, 0, 0), atol=1e-12)
    np.testing.assert_allclose(cameras[2].view_direction, (0, 1, 0), atol=1e-12)


def test_k_is_stored_column_by_column_and_follows_the_pictures_size(tmp_path):
    item = read_capture(make_record3d(tmp_path / "a")).cameras[0]
    assert (item.fx, item.fy, item.cx, item.cy, item.width, item.height) == (
        60,
        61,
        14.5,
        20.5,
        30,
        40,
    )
    item = read_capture(make_record3d(tmp_path / "b", size=(60, 80))).cameras[0]
    assert (item.fx, item.fy, item.cx, item.cy, item.width, item.height) == (
        120,
        122,
        29,
        41,
        60,
        80,
    )
    item = read_capture(make_record3d(tmp_path / "c", K=[K[:3], K[3:6], K[6:]])).cameras[0]
    assert (item.fx, item.fy, item.cx, item.cy) == (60, 61, 14.5, 20.5)


def test_intrinsics_of_each_picture_come_first(tmp_path):
    each = [[60.0 + i, 61.0 + i, 14.0, 20.0] for i in range(4)]
    cameras = read_capture(make_record3d(tmp_path, perFrameIntrinsicCoeffs=each)).cameras
    assert [(c.fx, c.fy) for c in cameras] == [(60 + i, 61 + i) for i in range(4)]


def test_a_depth_map_never_stands_in_for_a_missing_photo(tmp_path):
    folder = make_record3d(tmp_path)
    (folder / "rgb" / "2.jpg").unlink()
    capture = read_capture(folder)
    assert [c.image_path.name for c in capture.cameras] == ["0.jpg", "1.jpg", "3.jpg"]
    assert "rgb/2.jpg" in capture.warnings[0]


def test_a_recording_without_poses_is_named(tmp_path):
    folder = make_record3d(tmp_path, poses=[[0, 0, 0, 1, 0, 0, 0]] * 4)
    with pytest.raises(CaptureError, match="poses: all poses are the same; record with the LiDAR"):
        read_capture(folder)


@pytest.mark.parametrize(
    "changes, field",
    [
        ({"poses": 3}, "poses"), ({"poses": []}, "poses"), ({"poses": [[1, 2]] * 4}, r"poses\[0\]"),
        ({"poses": [*POSES[:3], [0] * 7]}, r"poses\[3\]"), ({"w": None}, "w"), ({"h": 0}, "w"),
        ({"K": [1, 2]}, "K"), ({"K": [float("nan")] * 9}, "K"),
        ({"perFrameIntrinsicCoeffs": [[1, 2]]}, r"perFrameIntrinsicCoeffs\[0\]"),
        ({"K": [-60.0, *K[1:]]}, r"poses\[0\]"),
    ],
)  # fmt: skip
def test_a_malformed_file_gets_an_error_with_its_field(tmp_path, changes, field):
    with pytest.raises(CaptureError, match=f"metadata.json, {field}: "):
        read_capture(make_record3d(tmp_path, **changes))


def test_other_json_is_not_taken_for_record3ds(tmp_path):
    for text in ("", "{}", '["poses", "K"]', '{"poses": 1}', '{"frames": [], "K": 1}'):
        (tmp_path / "metadata.json").write_text(text)
        assert not record3d.recognises(tmp_path / "metadata.json")
    assert not record3d.recognises(tmp_path / "none.json")


@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    key=st.sampled_from(["w", "h", "K", "poses", "pose", "perFrameIntrinsicCoeffs", "each"]),
    value=VALUES, keep=st.floats(0.3, 1.5),
)  # fmt: skip
def test_hostile_files_end_in_a_capture_or_an_error(tmp_path, key, value, keep):
    changes = {key: value}
    if key == "pose":
        changes = {"poses": [*POSES, value]}
    elif key == "each":
        changes = {"perFrameIntrinsicCoeffs": [value] * 4}
    file = make_record3d(tmp_path, **changes) / "metadata.json"
    file.write_text(file.read_text()[: int(keep * len(file.read_text()))])
    reads_or_refuses(tmp_path)
