"""Objects with Lighting's cameras: their projection, photos, masks, and files that are none."""

import numpy as np
import pytest

from solver.capture.errors import CaptureError
from solver.capture.formats import lit_objects
from solver.capture.read import read_capture
from tests.capture.programs import (
    COUNT,
    HEIGHT,
    WIDTH,
    check_projection,
    poses,
    save_photos,
)

LENS = np.array([[80.0, 0, 49.5], [0, 90.0, 30.25], [0, 0, 1]])


def make(folder, kind="", count=COUNT):
    """As `create_dataset_files.py` of the data set writes them."""
    save_photos(folder, [f"{kind}image_{i:04d}" for i in range(count)])
    save_photos(folder, [f"{kind}mask_{i:04d}" for i in range(count)])
    for i, from_world in enumerate(np.linalg.inv(poses()[:count])):
        parameters = LENS, from_world[:3, :3], from_world[:3, 3], (WIDTH, HEIGHT, 3)
        np.savetxt(folder / f"{kind}camera_{i:04d}.txt", np.vstack(parameters))
    (folder / "exposure.txt").write_text("1.5\n")
    (folder / "object_bounding_box.txt").write_text("-1 1 -1 1 -1 1\n")
    return folder


def project(index, point):
    x, y, z = LENS @ (np.linalg.inv(poses()[index]) @ [*point, 1])[:3]
    return x / z, y / z


@pytest.mark.parametrize("given_as", ["", "test", "test/inputs", "test/inputs/camera_0002.txt"])
def test_points_project_as_k_of_r_and_t_and_masks_lie_beside(tmp_path, given_as):
    inputs = make(tmp_path / "test" / "inputs")
    make(tmp_path / "test", kind="gt_", count=3)
    capture = read_capture(tmp_path / given_as)
    assert capture.format == lit_objects.NAME and not capture.warnings and capture.up is None
    check_projection(capture, project, poses())
    for camera in capture.cameras:
        assert camera.image_path.parent == inputs
        assert camera.mask_path.name == camera.image_path.name.replace("image", "mask")


def test_photos_under_another_light_are_read_alone(tmp_path):
    make(tmp_path, kind="gt_", count=3)
    make(tmp_path)
    capture = read_capture(tmp_path / "gt_camera_0001.txt")
    assert [camera.name for camera in capture.cameras] == [f"gt_image_{i:04d}" for i in range(3)]


@pytest.mark.parametrize(
    ("line", "words", "field"),
    [(0, "80 0 nan", "K"), (4, "0 0 0", "R"), (1, "1 2", "K, R, t, size"), (0, "8 9 7", "K")],
)
def test_a_malformed_file_gets_an_error_with_file_field_and_remedy(tmp_path, line, words, field):
    make(tmp_path)
    file = tmp_path / "camera_0003.txt"
    lines = file.read_text().splitlines()
    file.write_text("\n".join([*lines[:line], words, *lines[line + 1 :]]))
    with pytest.raises(CaptureError) as caught:
        read_capture(tmp_path)
    assert caught.value.file.name == file.name and field in caught.value.field
    assert caught.value.remedy


def test_empty_lines_around_the_numbers_do_not_count(tmp_path):
    for file in make(tmp_path).glob("camera_*.txt"):
        file.write_text(f"\n{file.read_text()}\n\n")
    assert len(read_capture(tmp_path).cameras) == COUNT
