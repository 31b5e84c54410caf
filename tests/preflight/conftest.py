"""Photos of the box that nothing is wrong with."""

import pytest

from tests.cameras.box_scene import BoxScene, box_camera
from tests.preflight.captures import around


@pytest.fixture(scope="session")
def pictures():
    """Photos of the box from all around with masks: cameras, colours, masks."""
    scene = BoxScene()
    cameras = [box_camera(pose, f"IMG_{i:03d}", None, 0.6) for i, pose in enumerate(around())]
    return cameras, [scene.photo(camera) for camera in cameras]


@pytest.fixture
def uncompared(monkeypatch):
    """A check does not compare photos with one another, which takes most of its time (see `test_poses`)."""
    monkeypatch.setattr("solver.preflight.check.poses", lambda *_: [])
