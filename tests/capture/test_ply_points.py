"""Sparse points of camera files: text and binary, and no harm from broken ones."""

import numpy as np
import pytest

from solver.cameras.output import write_points
from solver.capture.errors import CaptureError
from solver.capture.ply_points import read_ply_points
from solver.capture.read import read_capture
from tests.capture.test_capture import make_capture

TEXT = (
    "ply\nformat ascii 1.0\nelement vertex 2\nproperty uchar red\nproperty float x\n"
    "property float y\nproperty double z\nend_header\n7 1 2 3\n8 4 5 6.5\n"
)


def test_what_is_written_is_read_and_text_as_well(tmp_path):
    points = np.random.default_rng(0).normal(size=(20, 3)).astype(np.float32)
    write_points(tmp_path / "a.ply", points, np.zeros((20, 3), np.uint8))
    np.testing.assert_array_equal(read_ply_points(tmp_path / "a.ply"), points)
    (tmp_path / "b.ply").write_text(TEXT)
    assert read_ply_points(tmp_path / "b.ply").tolist() == [[1, 2, 3], [4, 5, 6.5]]


@pytest.mark.parametrize("content", [b"", b"ply\n", TEXT.encode()[:-12], TEXT.encode()[:60]])
def test_a_broken_file_of_points_is_left_out_with_a_warning(content, tmp_path):
    (tmp_path / "p.ply").write_bytes(content)
    with pytest.raises(CaptureError):
        read_ply_points(tmp_path / "p.ply")
    make_capture(tmp_path, edit=lambda c: c.update(ply_file_path="p.ply"))
    capture = read_capture(tmp_path)
    assert capture.points is None and "p.ply" in capture.warnings[0]


@pytest.mark.parametrize("stated", ["nowhere.ply", "../p.ply", "", 3, "a\0b"])
def test_points_elsewhere_are_not_read(stated, tmp_path):
    (tmp_path / "p.ply").write_text(TEXT)
    make_capture(tmp_path / "c", edit=lambda c: c.update(ply_file_path=stated))
    capture = read_capture(tmp_path / "c")
    assert capture.points is None and len(capture.warnings) <= 1
