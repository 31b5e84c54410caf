"""Sparse points from photos of known cameras."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from solver.capture import triangulate as module
from solver.capture.photo_matches import NEIGHBOURS, Picture, neighbours
from solver.capture.triangulate import compare_some, triangulate
from tests.capture.code_page import plain_colmap
from tests.capture.printed_table import HEIGHT, LENSES, WIDTH, camera_at, picture_at, printed


@pytest.fixture(scope="module")
def pattern():
    return printed()


@pytest.mark.parametrize("lens", LENSES)
def test_points_lie_on_what_is_printed_whatever_the_lens(pattern, lens):
    cameras = [camera_at(angle, lens) for angle in np.linspace(0, 1.2, 6)]
    points = triangulate(cameras, [picture_at(c, pattern) for c in cameras], lambda done: None).points
    assert len(points) > 300
    # A pixel is 1 cm wide there.
    assert np.percentile(np.abs(points[:, 2]), 95) < 0.02
    assert np.abs(points[:, :2]).max() < 1.55


def test_a_camera_file_for_larger_photos_gives_the_same_points(pattern):
    cameras = [camera_at(angle) for angle in np.linspace(0, 1.2, 6)]
    photos = [picture_at(camera, pattern) for camera in cameras]
    large = [
        replace(c, width=4 * WIDTH, height=4 * HEIGHT, fx=4 * c.fx, fy=4 * c.fy, cx=4 * c.cx, cy=4 * c.cy)
        for c in cameras
    ]
    as_they_are, enlarged = (
        triangulate(each, photos, lambda done: None).points for each in (cameras, large)
    )
    assert len(enlarged) == pytest.approx(len(as_they_are), rel=0.05)
    assert np.percentile(np.abs(enlarged[:, 2]), 95) < 0.02


def test_photos_of_nothing_in_common_give_no_points():
    cameras = [camera_at(angle) for angle in (0.0, 0.3, 0.6)]
    grey = Picture(np.full((HEIGHT, WIDTH), 128, np.uint8))
    assert triangulate(cameras, [grey] * 3, lambda done: None).points.shape == (0, 3)
    assert triangulate(cameras[:1], [grey], lambda done: None).points.shape == (0, 3)


def test_who_is_told_of_progress_may_end_it(pattern):
    cameras = [camera_at(angle) for angle in np.linspace(0, 1.2, 6)]

    class Enough(Exception):
        pass

    def stop(done):
        raise Enough

    with pytest.raises(Enough):
        triangulate(cameras, [picture_at(c, pattern) for c in cameras], stop)


def test_colmap_is_told_plain_letters_wherever_temporary_files_lie(pattern, tmp_path, monkeypatch):
    folder = tmp_path / "写真 ł"
    folder.mkdir()
    monkeypatch.setattr(module.tempfile, "tempdir", str(folder))
    monkeypatch.setattr(module, "quiet_colmap", plain_colmap)
    monkeypatch.setattr(module, "run_apart", lambda work, *args, progress: work(*args, progress))
    cameras = [camera_at(angle) for angle in np.linspace(0, 1.2, 6)]
    pictures = {camera.name: picture_at(camera, pattern) for camera in cameras}
    here = Path.cwd()
    assert len(triangulate(cameras, list(pictures.values()), lambda done: None, 0.0).points) > 300
    assert compare_some(cameras, lambda camera: pictures[camera.name]).beside < 1
    assert Path.cwd() == here and list(folder.iterdir()) == []


def test_cameras_are_compared_with_those_that_look_alike_from_nearby():
    ring = [camera_at(angle) for angle in np.linspace(0, 2 * math.pi, 40, endpoint=False)]
    pairs = neighbours(ring)
    assert all(i < j for i, j in pairs) and len(set(pairs)) == len(pairs)
    apart = np.array([min(j - i, 40 - (j - i)) for i, j in pairs])
    assert apart.max() <= NEIGHBOURS // 2 + 1
    # Every camera is compared with the next ones to either side.
    assert {(i, i + 1) for i in range(39)} <= set(pairs)
    # From one place in opposite directions nothing is seen by both.
    back_to_back = [camera_at(0.0, height=0.0), camera_at(math.pi, height=0.0)]
    assert neighbours(back_to_back) == []
