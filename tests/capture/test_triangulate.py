"""Sparse points from photos of known cameras."""

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.ndimage

from solver.capture.camera import Camera
from solver.capture.frames import pose_opengl_from_opencv
from solver.capture.photos import Photo, srgb_to_linear
from solver.capture.triangulate import NEIGHBOURS, neighbours, triangulate

WIDTH, HEIGHT = 240, 180
LENSES = {
    "pinhole": (),
    "opencv": (-0.15, 0.04, 0.002, -0.001),
    "opencv_fisheye": (0.03, -0.01, 0.0, 0.0),
}


def camera_at(angle, lens="pinhole", height=1.6):
    """A camera on a circle above the table that looks at its middle."""
    position = np.array([2.2 * math.cos(angle), 2.2 * math.sin(angle), height])
    forward = -position / np.linalg.norm(position)
    right = np.cross(forward, (0, 0, 1))
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = position
    return Camera(
        f"c{angle:.2f}", None, pose_opengl_from_opencv(pose), WIDTH, HEIGHT, 260.0, 255.0, 124.0,
        87.0, lens, LENSES[lens],
    )  # fmt: skip


def photo_of(camera, pattern):
    """What the camera sees of a printed table, z = 0, of half edge 1.5 in the dark."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    origins, directions = camera.rays(columns.ravel(), rows.ravel())
    place = origins - directions * (origins[:, 2:] / directions[:, 2:])
    at = (place[:, :2] / 3 + 0.5) * len(pattern) - 0.5
    seen = scipy.ndimage.map_coordinates(pattern, at.T, order=1, cval=0.0)
    pixels = np.repeat(srgb_to_linear(seen)[:, None], 3, axis=1)
    pixels = np.concatenate([pixels, np.ones_like(pixels[:, :1])], axis=1)
    return Photo(pixels.reshape(HEIGHT, WIDTH, 4).astype(np.float32), False, False)


@pytest.fixture(scope="module")
def pattern():
    rough = np.random.default_rng(3).random((300, 300))
    smooth = scipy.ndimage.gaussian_filter(rough, 1.5)
    return np.clip(0.5 + (smooth - 0.5) * 4, 0, 1)


@pytest.mark.parametrize("lens", LENSES)
def test_points_lie_on_what_is_printed_whatever_the_lens(pattern, lens):
    cameras = [camera_at(angle, lens) for angle in np.linspace(0, 1.2, 6)]
    points = triangulate(cameras, [photo_of(c, pattern) for c in cameras], lambda done: None)
    assert len(points) > 300
    # A pixel is 1 cm wide there.
    assert np.percentile(np.abs(points[:, 2]), 95) < 0.02
    assert np.abs(points[:, :2]).max() < 1.55


def test_a_camera_file_for_larger_photos_gives_the_same_points(pattern):
    cameras = [camera_at(angle) for angle in np.linspace(0, 1.2, 6)]
    photos = [photo_of(camera, pattern) for camera in cameras]
    large = [
        replace(c, width=4 * WIDTH, height=4 * HEIGHT, fx=4 * c.fx, fy=4 * c.fy, cx=4 * c.cx, cy=4 * c.cy)
        for c in cameras
    ]  # fmt: skip
    as_they_are, enlarged = (
        triangulate(each, photos, lambda done: None) for each in (cameras, large)
    )
    assert len(enlarged) == pytest.approx(len(as_they_are), rel=0.05)
    assert np.percentile(np.abs(enlarged[:, 2]), 95) < 0.02


def test_photos_of_nothing_in_common_give_no_points():
    cameras = [camera_at(angle) for angle in (0.0, 0.3, 0.6)]
    grey = Photo(np.full((HEIGHT, WIDTH, 4), 0.5, np.float32), False, False)
    assert triangulate(cameras, [grey] * 3, lambda done: None).shape == (0, 3)
    assert triangulate(cameras[:1], [grey], lambda done: None).shape == (0, 3)


def test_who_is_told_of_progress_may_end_it(pattern):
    cameras = [camera_at(angle) for angle in np.linspace(0, 1.2, 6)]

    class Enough(Exception):
        pass

    def stop(done):
        raise Enough

    with pytest.raises(Enough):
        triangulate(cameras, [photo_of(c, pattern) for c in cameras], stop)


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
