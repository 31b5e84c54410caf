"""What leaves by the command line stands where Blender shows it."""

import json

import bpy
import numpy as np
import pytest
from fake_capture import write_capture
from mathutils import Euler, Matrix

from solver.capture.read import read_capture
from solver.job.inputs import placement_of
from solver.job.request import JobRequest


@pytest.fixture
def create(extension, tmp_path):
    """Write a job for a capture; where it is to stand."""

    def run(capture):
        job = extension("jobs.create").create_job(capture, tmp_path / "job")
        return np.array(job.request.placement)

    return run


def test_a_job_of_blender_says_where_the_person_put_its_capture(extension, create, capture):
    root = extension("scene.capture_collection").root_of(capture)
    root.location, root.rotation_euler = (1.0, 2.0, 3.0), Euler((0.3, -0.2, 1.0))
    root.scale = (0.4, 0.4, 0.4)
    placement = create(capture)
    np.testing.assert_allclose(placement, root.matrix_world, atol=1e-6)
    assert placement[0, 3] == 1.0


def test_a_capture_that_nobody_moved_stays_where_it_is_to_the_last_bit(create, capture):
    np.testing.assert_array_equal(create(capture), np.eye(4))


def test_a_capture_that_was_scaled_unevenly_has_the_mean_of_its_scales(extension, create, capture):
    extension("scene.capture_collection").root_of(capture).scale = (1.0, 2.0, 4.0)
    np.testing.assert_allclose(create(capture), np.diag([2.0, 2.0, 2.0, 1.0]), atol=1e-6)


def test_without_blender_a_capture_is_placed_as_its_import_places_it(extension, tmp_path):
    scene = extension("scene.capture_collection")
    path = write_capture(tmp_path / "photos", count=6)
    tilted = np.array(Matrix.Rotation(1.1, 4, "X"))
    content = json.loads(path.read_text(encoding="utf-8"))
    for frame in content["frames"]:
        frame["transform_matrix"] = (tilted @ frame["transform_matrix"]).tolist()
    content["applied_transform"] = np.eye(4)[:3].tolist()  # nerfstudio's word for: up is unknown
    path.write_text(json.dumps(content), encoding="utf-8")
    collection = extension("scene.import_captures").import_capture(bpy.context, path)
    asked = placement_of(JobRequest(capture=str(path)), read_capture(path))
    shown = np.reshape(scene.root_of(collection)[scene.FILE_TO_CAPTURE], (4, 4))
    np.testing.assert_array_equal(asked, shown)
    up = asked[:3, :3] @ tilted[:3, 2]
    np.testing.assert_allclose(up / np.linalg.norm(up), (0, 0, 1), atol=1e-3)
