"""NeILF's sfm_scene.json: its projection, cameras that are not known, its box, and hostile files."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solver.capture.errors import CaptureError
from solver.capture.formats import neilf
from solver.capture.read import read_capture, reader_of
from tests.capture.programs import (
    HEIGHT,
    HOSTILE,
    RANDOM_TESTS,
    WIDTH,
    check_projection,
    names,
    outcome,
    places,
    poses,
    put,
    save_photos,
)

FX, FY, CX, CY = 80.0, 90.0, 49.5, 30.25
BOX = [3, 0, 0, 0.5, 0, 4, 0, -0.25, 0, 0, 2, 0, 0, 0, 0, 1]


def scene():
    cameras = {
        str(index): {
            "size": [WIDTH, HEIGHT], "flg": 2,
            "camera": {
                "extrinsic": np.linalg.inv(pose).ravel().tolist(),
                "intrinsic": {"focal": [FX, FY], "ppt": [CX, CY], "distort_params": [0, 0, 0]},
            },
        }
        for index, pose in enumerate(poses())
    }  # fmt: skip
    return {
        "image_path": {"file_paths": {str(i): f"images/{name}.png" for i, name in enumerate(names())}},
        "bbox": {"transform": list(BOX)}, "camera_track_map": {"images": cameras},
    }  # fmt: skip


def write(folder, content):
    save_photos(folder / "inputs" / "images")
    (folder / "inputs" / "sfm_scene.json").write_text(json.dumps(content))
    return folder


def project(index, point):
    x, y, z = (np.linalg.inv(poses()[index]) @ [*point, 1])[:3]
    return FX * x / z + CX, FY * y / z + CY


@pytest.mark.parametrize("stated", ["{}.png", "/data/vase/{}.png", "inputs\\images\\{}.png"])
def test_of_a_photos_path_its_name_alone_counts(tmp_path, stated):
    """NeILF's own loader looks in inputs/images, beside which maps have the same names."""
    content = scene()
    paths = content["image_path"]["file_paths"]
    paths |= {str(i): stated.format(name) for i, name in enumerate(names())}
    folder = write(tmp_path, content)
    for maps in ("position_maps", "normal_maps"):
        save_photos(folder / "inputs" / maps)
    capture = read_capture(folder)
    assert len(capture.cameras) == len(names())
    assert all(camera.image_path.parent.name == "images" for camera in capture.cameras)


def test_photos_in_another_folder_are_those_that_the_path_tells(tmp_path):
    content = scene()
    paths = content["image_path"]["file_paths"]
    paths |= {str(i): f"rgb/{name}.png" for i, name in enumerate(names())}
    folder = write(tmp_path, content)
    (folder / "inputs" / "images").rename(folder / "inputs" / "rgb")
    save_photos(folder / "inputs" / "position_maps")
    assert all(c.image_path.parent.name == "rgb" for c in read_capture(folder).cameras)


@pytest.mark.parametrize("given_as", ["", "vase", "vase/inputs", "vase/inputs/sfm_scene.json"])
def test_points_project_with_opencvs_axes_and_the_box_is_the_region(tmp_path, given_as):
    write(tmp_path / "vase", scene())
    capture = read_capture(tmp_path / given_as)
    assert capture.format == neilf.NAME and not capture.warnings and capture.up is None
    check_projection(capture, project, poses())
    np.testing.assert_allclose(capture.region, [[-1.5, -2.25, -2], [2.5, 1.75, 2]])


def test_matrices_may_be_nested_and_a_box_is_not_needed(tmp_path):
    content = scene()
    del content["bbox"]
    for camera in content["camera_track_map"]["images"].values():
        camera["camera"]["extrinsic"] = np.reshape(camera["camera"]["extrinsic"], (4, 4)).tolist()
    check_projection(read_capture(write(tmp_path, content)), project, poses())


def test_a_box_that_is_turned_is_not_used(tmp_path):
    content = scene()
    content["bbox"]["transform"] = [0, 3, 0, 0, -3, 0, 0, 0, 0, 0, 3, 0, 0, 0, 0, 1]
    capture = read_capture(write(tmp_path, content))
    assert "bbox.transform is not an upright box" in capture.warnings[0]


def test_cameras_that_were_not_found_are_left_out_with_a_warning(tmp_path):
    content = scene()
    content["camera_track_map"]["images"]["3"]["flg"] = 1
    capture = read_capture(write(tmp_path, content))
    assert len(capture.cameras) == 4 and "1 of 5 photos has no pose" in capture.warnings[0]


def test_a_renamed_file_is_recognised_by_its_content(tmp_path):
    file = write(tmp_path, scene()) / "inputs" / "sfm_scene.json"
    assert reader_of(file.rename(tmp_path / "inputs" / "vase.json")) is neilf


@pytest.mark.parametrize(
    ("at", "value", "field"),
    [
        (("image_path",), None, "image_path"),
        (("image_path", "file_paths"), ["a"], "image_path.file_paths"),
        (("image_path", "file_paths", "2"), 7, "image_path.file_paths.2"),
        (("camera_track_map", "images"), [], "camera_track_map.images"),
        (("camera_track_map", "images", "2", "camera", "extrinsic"), [1, 2], "images.2.camera.extrinsic"),
        (("camera_track_map", "images", "2", "camera", "extrinsic"), [0] * 16, "images.2.camera.extrinsic"),
        (("camera_track_map", "images", "2", "camera", "intrinsic", "focal"), [1], "camera.intrinsic.focal"),
        (("camera_track_map", "images", "2", "size"), None, "images.2.size"),
        (("bbox", "transform"), "a", "bbox.transform"),
    ],
)  # fmt: skip
def test_a_malformed_file_gets_an_error_with_file_field_and_remedy(tmp_path, at, value, field):
    content = scene()
    put(content, at, value)
    with pytest.raises(CaptureError) as caught:
        read_capture(write(tmp_path, content))
    assert field in caught.value.field and caught.value.remedy


@RANDOM_TESTS
@given(data=st.data())
def test_hostile_values_end_in_a_capture_or_an_error(tmp_path, data):
    content = scene()
    put(content, data.draw(st.sampled_from(places(content))), data.draw(HOSTILE))
    text = json.dumps(content)
    write(tmp_path, content)
    file = tmp_path / "inputs" / "sfm_scene.json"
    file.write_text(text[: data.draw(st.integers(0, len(text)) | st.just(len(text)))])
    outcome(file)
    outcome(tmp_path)
