"""Nerfies' captures: its own projection, photos of all scales, what is for validation, points, hostile files."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solver.capture.errors import CaptureError
from solver.capture.formats import nerfies
from solver.capture.read import read_capture, reader_of
from tests.capture.programs import (
    COUNT,
    HEIGHT,
    HOSTILE,
    RANDOM_TESTS,
    WIDTH,
    check_projection,
    outcome,
    places,
    poses,
    put,
    save_photos,
)

IDS = [f"left_{index:04d}" for index in range(COUNT)]
F, ASPECT, SKEW, CX, CY = 80.0, 1.03, 1.5, 50.5, 30.25
RADIAL, TANGENTIAL = (-0.11, 0.04, -0.003), (0.004, -0.007)


def camera_json(pose, tangential="tangential"):
    return {
        "orientation": pose[:3, :3].T.tolist(), "position": pose[:3, 3].tolist(), "focal_length": F,
        "principal_point": [CX, CY], "skew": SKEW, "pixel_aspect_ratio": ASPECT,
        "radial_distortion": list(RADIAL), tangential: list(TANGENTIAL), "image_size": [WIDTH, HEIGHT],
    }  # fmt: skip


def make(folder, cameras=None, scale=1, **options):
    cameras = [camera_json(pose, **options) for pose in poses()] if cameras is None else cameras
    (folder / "camera").mkdir(parents=True, exist_ok=True)
    for name, content in zip(IDS, cameras, strict=False):
        (folder / "camera" / f"{name}.json").write_text(json.dumps(content))
    (folder / "scene.json").write_text('{"scale": 0.03, "center": [1, 2, 3], "near": 0.1, "far": 1}')
    save_photos(folder / "rgb" / f"{scale}x", IDS, (WIDTH // scale, HEIGHT // scale))
    return folder


def reference(index, point):
    """`Camera.project` of Nerfies' camera.py, number by number."""
    x, y, z = poses()[index, :3, :3].T @ (point - poses()[index, :3, 3])
    x, y = x / z, y / z
    r2 = x**2 + y**2
    distortion = 1 + r2 * (RADIAL[0] + r2 * (RADIAL[1] + RADIAL[2] * r2))
    u = x * distortion + 2 * TANGENTIAL[0] * x * y + TANGENTIAL[1] * (r2 + 2 * x**2)
    v = y * distortion + 2 * TANGENTIAL[1] * x * y + TANGENTIAL[0] * (r2 + 2 * y**2)
    return F * u + SKEW * v + CX, F * ASPECT * v + CY


@pytest.mark.parametrize("tangential", ["tangential", "tangential_distortion"])
@pytest.mark.parametrize("given_as", ["", "camera", "camera/left_0002.json", ".."])
def test_points_project_as_nerfies_projects_them(tmp_path, given_as, tangential):
    folder = make(tmp_path / "captures" / "broom", tangential=tangential)
    save_photos(folder / "rgb" / "2x", IDS, (WIDTH // 2, HEIGHT // 2))
    capture = read_capture(folder / given_as)
    assert capture.format == "Nerfies" and not capture.warnings
    assert {camera.image_path.parent.name for camera in capture.cameras} == {"1x"}
    check_projection(capture, reference, poses())


def test_the_lens_follows_photos_of_another_scale(tmp_path):
    capture = read_capture(make(tmp_path, scale=4))
    camera = capture.cameras[0]
    assert (camera.width, camera.fx, camera.cx) == (WIDTH // 4, F / 4, CX / 4)
    assert "another size for 5 of 5 photos" in capture.warnings[0]


def test_photos_for_validation_are_left_out(tmp_path):
    folder = make(tmp_path)
    (folder / "dataset.json").write_text(json.dumps({"ids": IDS, "train_ids": IDS[:4], "val_ids": IDS[4:]}))
    capture = read_capture(folder)
    assert [camera.name for camera in capture.cameras] == IDS[:4]
    assert capture.warnings == ("1 photo for validation is left out (dataset.json)",)
    (folder / "dataset.json").write_text('{"train_ids": []}')
    assert len(read_capture(folder).cameras) == COUNT


def test_points_are_the_surroundings(tmp_path):
    folder = make(tmp_path)
    points = np.random.default_rng(0).normal(size=(9, 3))
    np.save(folder / "points.npy", points)
    np.testing.assert_allclose(read_capture(folder).points, points)
    np.save(folder / "points.npy", points[:, :2])
    assert "points.npy: these are not points" in read_capture(folder).warnings[0]
    (folder / "points.npy").write_bytes(b"\x93NUMPY")
    capture = read_capture(folder)
    assert capture.points is None and "points.npy: this is not an array" in capture.warnings[0]


@pytest.mark.parametrize(
    "key, value, problem",
    [
        ("orientation", [[1, 0, 0], [0, 1, 0]], "orientation: the pose's rotation is singular"),
        ("orientation", [[1, 0, 0], [0, 1, 0], [0, 0, -1]], "orientation: the pose mirrors the world"),
        ("orientation", [[1, 0], [0, 1], [0, 0]], r"orientation\[0\]: '\[1, 0\]' is not 3 numbers"),
        ("position", None, "position: 'None' is not 3 numbers"),
        ("focal_length", 0, "focal_length: it is not positive"),
        ("focal_length", "far", "focal_length: 'far' is not a number"),
        ("radial_distortion", [1, 2], "radial_distortion: .* is not 3 numbers"),
        ("tangential", None, "tangential: 'None' is not 2 numbers"),
        ("image_size", [HEIGHT, WIDTH], "the photo is 96 × 64 pixels, but"),
    ],
)
def test_what_is_wrong_with_a_file_is_named(tmp_path, key, value, problem):
    cameras = [camera_json(pose) for pose in poses()]
    cameras[1][key] = value
    with pytest.raises(CaptureError, match=problem):
        read_capture(make(tmp_path, cameras))


def test_only_cameras_are_recognised(tmp_path):
    folder = make(tmp_path)
    assert reader_of(folder / "camera" / f"{IDS[0]}.json") is nerfies
    assert reader_of(folder / "scene.json") is None


@RANDOM_TESTS
@given(data=st.data())
def test_hostile_values_end_in_a_capture_or_an_error(tmp_path, data):
    cameras = [camera_json(pose) for pose in poses()]
    put(cameras[2], data.draw(st.sampled_from(places(cameras[2]))), data.draw(HOSTILE))
    outcome(make(tmp_path, cameras))


@RANDOM_TESTS
@given(data=st.data(), listed=HOSTILE)
def test_files_cut_off_and_lists_of_anything_end_in_a_capture_or_an_error(tmp_path, data, listed):
    folder = make(tmp_path)
    (folder / "dataset.json").write_text(json.dumps({"train_ids": listed}))
    outcome(folder)
    text = json.dumps(camera_json(poses()[0]))
    cut = text[: data.draw(st.integers(0, len(text) - 1))]
    (folder / "camera" / f"{IDS[0]}.json").write_text(cut)
    (folder / "dataset.json").unlink()
    with pytest.raises(CaptureError, match=rf"{IDS[0]}.json, line 1: this is not valid JSON"):
        read_capture(folder / "camera" / f"{IDS[1]}.json")
