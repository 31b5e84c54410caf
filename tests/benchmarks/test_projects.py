"""The same capture, exported by several programs, is read as the same capture."""

import numpy as np
import pytest

from benchmarks.projects import WRITERS, write_project
from solver.capture.placement import placed, suggest_placement
from solver.capture.read import read_capture
from tests.capture.test_capture import make_capture


@pytest.mark.parametrize("program", WRITERS)
def test_a_project_of_another_program_holds_the_cameras_it_was_made_of(tmp_path, program):
    capture = read_capture(make_capture(tmp_path / "scene", count=12))
    matrix = write_project(program, capture, tmp_path / "project", seed=3)
    read = read_capture(tmp_path / "project")
    assert len(read.cameras) == 12 and read.up is None
    moved = placed(capture, matrix)
    points = np.random.default_rng(0).uniform(-0.4, 0.4, (20, 3))
    there = points @ matrix[:3, :3].T + matrix[:3, 3]
    seen = np.sort([camera.project(there)[0] for camera in read.cameras], axis=0)
    expected = np.sort([camera.project(there)[0] for camera in moved.cameras], axis=0)
    np.testing.assert_allclose(seen, expected, atol=1e-6)


@pytest.mark.parametrize("program", WRITERS)
def test_whatever_the_program_the_capture_stands_upright_in_its_box(tmp_path, program):
    capture = read_capture(make_capture(tmp_path / "scene", count=12))
    write_project(program, capture, tmp_path / "project", seed=4)
    read = read_capture(tmp_path / "project")
    upright = placed(read, suggest_placement(read))
    ups = np.stack([camera.camera_to_world[:3, 1] for camera in upright.cameras])
    assert (ups[:, 2] > 0.9).all()
    np.testing.assert_allclose(upright.region.mean(0), 0, atol=0.05)
