"""PhySG's, IRON's and NeRF++'s cameras: their projection, photos, masks, and files that are none."""

import json

import numpy as np
import pytest

from solver.capture.errors import CaptureError
from solver.capture.formats import camera_dictionary
from solver.capture.read import read_capture
from tests.capture.programs import HEIGHT, WIDTH, check_projection, names, poses, save_photos

LENS = np.array([[80.0, 0, 49.5, 0], [0, 90.0, 30.25, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
NAMES = [f"{name}.png" for name in names()]


def make(folder, name="train/cam_dict_norm.json", photos="train/image"):
    """As NeRF++'s `extract_sfm.py` and `normalize_cam_dict.py` write them."""
    save_photos(folder / photos)
    cameras = {
        photo: {"K": LENS.ravel().tolist(), "W2C": from_world.ravel().tolist(), "img_size": [WIDTH, HEIGHT]}
        for photo, from_world in zip(NAMES, np.linalg.inv(poses()), strict=True)
    }
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(json.dumps(cameras, indent=2))
    return folder


def project(index, point):
    x, y, z = LENS[:3, :3] @ (np.linalg.inv(poses()[index]) @ [*point, 1])[:3]
    return x / z, y / z


@pytest.mark.parametrize(
    ("name", "photos"),
    [
        ("train/cam_dict_norm.json", "train/image"),
        ("cam_dict_norm.json", "image"),
        ("posed_images/kai_cameras_normalized.json", "posed_images/images"),
        ("kai_cameras_normalized.json", "rgb"),
        ("scene.json", "somewhere"),
    ],
)
def test_points_project_as_k_of_w2c(tmp_path, name, photos):
    capture = read_capture(make(tmp_path, name, photos))
    assert capture.format == camera_dictionary.NAME and not capture.warnings and capture.up is None
    check_projection(capture, project, poses())
    assert [camera.image_path for camera in capture.cameras] == [tmp_path / photos / n for n in NAMES]


def test_masks_in_a_folder_beside_the_photos_are_used_and_test_photos_left_out(tmp_path):
    make(tmp_path)
    make(tmp_path, "test/cam_dict_norm.json", "test/image")
    save_photos(tmp_path / "train/mask")
    capture = read_capture(tmp_path)
    for camera, name in zip(capture.cameras, NAMES, strict=True):
        assert camera.image_path == tmp_path / "train/image" / name
        assert camera.mask_path == tmp_path / "train/mask" / name


@pytest.mark.parametrize(
    ("key", "value", "field"),
    [
        ("K", [80, 0, 50], "K"),
        ("K", [0.0] * 16, "K"),
        ("W2C", [0.0] * 16, "W2C"),
        ("W2C", None, "W2C"),
        ("img_size", ["a", 3], "img_size"),
    ],
)
def test_a_malformed_file_gets_an_error_with_file_field_and_remedy(tmp_path, key, value, field):
    file = make(tmp_path) / "train/cam_dict_norm.json"
    cameras = json.loads(file.read_text())
    cameras[NAMES[3]][key] = value
    file.write_text(json.dumps(cameras))
    with pytest.raises(CaptureError) as caught:
        read_capture(tmp_path)
    assert (
        caught.value.file == file
        and caught.value.field.startswith(f"{NAMES[3]}.{field}")
        and caught.value.remedy
    )
