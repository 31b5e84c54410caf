"""NeRFactor's views in folders of their own: its projection, splits, and hostile files."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solver.capture.errors import CaptureError
from solver.capture.formats import nerfactor
from solver.capture.frames import pose_opengl_from_opencv
from solver.capture.read import read_capture, reader_of
from tests.capture.programs import (
    COUNT,
    HEIGHT,
    HOSTILE,
    RANDOM_TESTS,
    WIDTH,
    outcome,
    poses,
    save_photos,
    seen_points,
)

ANGLE = 1.0


def metadata(index):
    matrix = pose_opengl_from_opencv(poses()[index])
    return {
        "cam_angle_x": ANGLE, "cam_transform_mat": ",".join(str(float(x)) for x in matrix.ravel()),
        "envmap": "city", "envmap_inten": 3.0, "imh": HEIGHT, "imw": WIDTH, "scene": "", "spp": 256,
    }  # fmt: skip


def write(folder, splits=("train", "val"), change=None):
    for split in splits:
        for index in range(COUNT):
            view = folder / f"{split}_{index:03d}"
            save_photos(view, ["rgba", "albedo", "normal"])
            content = metadata(index)
            if change is not None and index == 2:
                content |= change
            (view / "metadata.json").write_text(json.dumps(content))
    return folder


def test_points_project_as_its_rays_are_cast(tmp_path):
    capture = read_capture(write(tmp_path))
    assert capture.format == nerfactor.NAME and not capture.warnings
    focal = 0.5 * WIDTH / math.tan(0.5 * ANGLE)
    assert [camera.image_path.parent.name for camera in capture.cameras] == [
        f"train_{index:03d}" for index in range(COUNT)
    ]
    for index, camera in enumerate(capture.cameras):
        assert camera.image_path.name == "rgba.png"
        points = seen_points(poses()[index])
        x, y, z = np.linalg.inv(poses()[index])[:3] @ np.c_[points, np.ones(len(points))].T
        wanted = np.stack([focal * x / z + WIDTH / 2, focal * y / z + HEIGHT / 2], axis=-1)
        np.testing.assert_allclose(camera.project(points)[0], wanted, atol=1e-6)


def test_where_transforms_lie_beside_the_views_these_are_read(tmp_path):
    frames = [
        {"file_path": f"./train_{i:03d}/rgba", "transform_matrix": poses()[i].tolist()}
        for i in range(COUNT)
    ]
    content = {"camera_angle_x": 0.7, "frames": frames}
    (write(tmp_path) / "transforms_train.json").write_text(json.dumps(content))
    assert read_capture(tmp_path).format == "transforms.json"


def test_photos_of_half_the_size_have_lenses_of_half_the_size(tmp_path):
    for index in range(COUNT):
        view = tmp_path / f"train_{index:03d}"
        save_photos(view, ["rgba"], (WIDTH // 2, HEIGHT // 2))
    camera = read_capture(write(tmp_path)).cameras[0]
    assert (camera.width, camera.fx) == (WIDTH // 2, 0.25 * WIDTH / math.tan(0.5 * ANGLE))


def test_a_renamed_file_is_recognised_by_its_content(tmp_path):
    file = write(tmp_path) / "train_000" / "metadata.json"
    assert reader_of(file.rename(tmp_path / "train_000" / "camera.txt")) is nerfactor


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"cam_angle_x": 40}, "cam_angle_x"),
        ({"cam_angle_x": None}, "cam_angle_x"),
        ({"cam_transform_mat": "1,2,3"}, "cam_transform_mat"),
        ({"cam_transform_mat": "0," * 15 + "1"}, "cam_transform_mat"),
        ({"imw": "wide"}, "imw"),
        ({"imh": 0}, "cam_transform_mat"),
    ],
)
def test_a_malformed_file_gets_an_error_with_file_field_and_remedy(tmp_path, change, field):
    with pytest.raises(CaptureError) as caught:
        read_capture(write(tmp_path, ("train",), change))
    assert field in caught.value.field and caught.value.remedy


@RANDOM_TESTS
@given(data=st.data())
def test_hostile_values_end_in_a_capture_or_an_error(tmp_path, data):
    key = data.draw(st.sampled_from(sorted(metadata(0))))
    write(tmp_path, ("train",), {key: data.draw(HOSTILE)})
    file = tmp_path / "train_002" / "metadata.json"
    text = file.read_text()
    file.write_text(text[: data.draw(st.integers(0, len(text)) | st.just(len(text)))])
    outcome(tmp_path)
    outcome(file)


def test_a_folder_of_views_that_may_not_be_listed_is_told(tmp_path, monkeypatch):
    file = write(tmp_path) / "train_000" / "metadata.json"
    listed = Path.iterdir

    def refuse(folder):
        if folder == tmp_path:
            raise PermissionError(13, "Permission denied", str(folder))
        return listed(folder)

    monkeypatch.setattr(Path, "iterdir", refuse)
    with pytest.raises(CaptureError, match="cannot be read; check its permissions") as caught:
        read_capture(file)
    assert caught.value.file == tmp_path
