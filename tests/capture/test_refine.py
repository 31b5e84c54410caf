"""Cameras that are off are seen by what their photos have in common, and adjusted to them."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize
import trimesh
from scipy.spatial.transform import Rotation

from solver.capture import refine
from solver.capture.agreement import convention_that_fits, disagreement, epipolar_errors
from solver.capture.frames import (
    invert_pose,
    opencv_from_opengl,
    pose_opencv_from_opengl,
    pose_opengl_from_opencv,
    unit,
)
from solver.capture.photo_matches import PairMatches
from solver.capture.refine import TOLERATED
from solver.capture.triangulate import triangulate
from solver.job.adjusted import adjusted, write_adjusted
from solver.job.request import JobError
from tests.capture.poses import ring
from tests.capture.printed_table import camera_at, picture_at, printed, shaken

FOCAL = 500.0


def matches_of(cameras, points, noise=0.0, seed=0):
    """What pairs of cameras see of points [N, 3], with noise of so many pixels in both."""
    rng = np.random.default_rng(seed)
    pairs = []
    for i in range(len(cameras) - 1):
        seen = []
        for camera in (cameras[i], cameras[i + 1]):
            local = (points - camera.position) @ camera.camera_to_world[:3, :3]
            local = opencv_from_opengl(local)
            flat = local / local[:, 2:]
            flat[:, :2] += noise / FOCAL * rng.normal(size=(len(points), 2))
            seen.append(flat)
        pairs.append(PairMatches(i, i + 1, np.stack(seen), FOCAL))
    return pairs


@pytest.fixture(scope="module")
def points():
    return np.random.default_rng(5).uniform(-0.5, 0.5, (40, 3))


def test_what_right_cameras_see_lies_where_they_say_wherever_they_stand(points):
    assert epipolar_errors(ring(8), matches_of(ring(8), points)).max() < 1e-6


def test_the_error_is_how_far_matches_must_move_to_be_of_one_point(points):
    """Against an optimiser that moves both until the rays meet."""
    cameras = ring(4)
    pairs = matches_of(cameras, points[:15], noise=1.0)
    found = epipolar_errors(cameras, pairs)
    for pair, error in zip(pairs, found, strict=True):
        first, second = (cameras[i] for i in (pair.first, pair.second))
        turn = invert_pose(pose_opencv_from_opengl(second.camera_to_world)) @ pose_opencv_from_opengl(
            first.camera_to_world
        )

        def apart(move, a, b, turn=turn):
            to_first = a + scipy.linalg.null_space(a[None]) @ move[:2]
            to_second = b + scipy.linalg.null_space(b[None]) @ move[2:]
            return np.cross(turn[:3, 3], turn[:3, :3] @ to_first) @ to_second

        least = [
            FOCAL * np.linalg.norm(scipy.optimize.minimize(
                lambda m: 1e6 * m @ m, np.zeros(4), method="SLSQP",
                constraints={"type": "eq", "fun": apart, "args": (a, b)},
            ).x)
            for a, b in zip(*unit(pair.seen), strict=True)
        ]  # fmt: skip
        assert error == pytest.approx(np.median(least), rel=0.01)


def test_too_few_matches_or_cameras_at_one_place_tell_nothing(points):
    cameras = ring(6)
    assert disagreement(cameras, matches_of(cameras, points[:14])) is None
    assert disagreement(cameras, matches_of(cameras, points)[:2]) is not None
    assert disagreement(cameras, []) is None
    at_one_place = [replace(c, camera_to_world=cameras[0].camera_to_world) for c in cameras]
    assert disagreement(at_one_place, matches_of(at_one_place, points)) is None


@pytest.mark.parametrize("words, told", [
    ("negate the second", pose_opengl_from_opencv), ("invert each, since", invert_pose),
    ("invert each and negate", lambda pose: invert_pose(pose_opengl_from_opencv(pose))),
])  # fmt: skip
def test_matrices_in_another_convention_are_told_from_cameras_that_are_off(points, words, told):
    cameras = ring(8)
    pairs = matches_of(cameras, points, noise=0.3)
    assert convention_that_fits(cameras, pairs) is None
    others = [replace(c, camera_to_world=told(c.camera_to_world)) for c in cameras]
    assert convention_that_fits(others, pairs).startswith(words)
    strewn = [replace(c, camera_to_world=c.camera_to_world[:, [1, 2, 0, 3]]) for c in cameras]
    assert convention_that_fits(strewn, pairs) is None


def test_photos_that_lie_upside_down_are_told_from_cameras_that_are_off():
    cameras = ring(8)
    # A room: what is in the middle of all photos alone is there upside down as well.
    points = np.random.default_rng(2).uniform(-2, 2, (60, 3)) * (1, 1, 0.5)
    pairs = matches_of(cameras, points, noise=0.3)
    assert convention_that_fits(cameras, pairs) is None
    half = np.diag([-1.0, -1.0, 1.0, 1.0])
    others = [replace(c, camera_to_world=c.camera_to_world @ half) for c in cameras]
    assert convention_that_fits(others, pairs).startswith("rotate the photos by 180°")


def turns_and_ways(found, true):
    """Degrees by which turns from each camera to the next are off, and distances by which positions are,
    whatever world they are in."""
    turns = []
    for i in range(len(true) - 1):
        first, second = (
            c[i].camera_to_world[:3, :3].T @ c[i + 1].camera_to_world[:3, :3] for c in (found, true)
        )
        turns.append(np.degrees(Rotation.from_matrix(first.T @ second).magnitude()))
    at, to = (np.stack([c.position for c in cameras]) for cameras in (found, true))
    moved = trimesh.registration.procrustes(at, to, reflection=False)[1]
    return max(turns), np.linalg.norm(moved - to, axis=1).max()


@pytest.fixture(scope="module")
def table():
    cameras = [camera_at(angle, "opencv") for angle in np.linspace(0, 2.4, 12)]
    pattern = printed()
    return cameras, [picture_at(camera, pattern) for camera in cameras]


@pytest.mark.parametrize("degrees, share", [(0.7, 0.01), (3.0, 0.03)])
def test_cameras_that_are_off_are_adjusted_until_their_photos_fit(table, degrees, share):
    cameras, photos = table
    off = shaken(cameras, degrees, share)
    found = triangulate(off, photos, lambda done: None, tolerated=TOLERATED)
    assert found.beside > 2 * TOLERATED and found.refined_beside < 0.5
    assert found.remedy is None
    turn, way = turns_and_ways(found.refined, cameras)
    assert turn < 0.15 and way < 0.01
    # The world is that of the cameras that were given.
    to, at = (np.stack([c.position for c in each]) for each in (off, found.refined))
    assert np.linalg.norm(to.mean(0) - at.mean(0)) < 0.01
    # What they see is one flat table.
    centred = found.points - found.points.mean(0)
    assert np.linalg.svd(centred / np.sqrt(len(centred)))[1][2] < 0.01
    assert found.refined[0].lens == "opencv" and found.refined[0].name == cameras[0].name


def test_rounds_begin_above_what_cameras_are_off_and_end_strict():
    assert refine.rounds_for(1.0) == [16.0, 4.0]
    assert refine.rounds_for(11.0) == [44.0, 11.0, 4.0]
    assert refine.rounds_for(16.0) == [64.0, 16.0, 4.0]


def test_cameras_that_fit_stay_as_they_are(table):
    cameras, photos = table
    found = triangulate(cameras, photos, lambda done: None, tolerated=TOLERATED)
    assert found.beside < TOLERATED and found.refined is None and len(found.points) > 300
    off = shaken(cameras, 0.7, 0.01)
    assert triangulate(off, photos, lambda done: None).refined is None


def test_photos_of_something_else_than_what_cameras_went_around_move_no_camera(table):
    """As of a room behind a turntable, which stands still in all of them."""
    cameras, photos = table
    found = triangulate(cameras, photos[:1] * len(cameras), lambda done: None, tolerated=TOLERATED)
    assert found.refined is None


def test_cameras_may_not_leap_or_turn_far(table):
    cameras, _ = table
    leapt = [
        replace(c, camera_to_world=c.camera_to_world * (1, 1, 1, 1 + (i % 2)))
        for i, c in enumerate(cameras)
    ]
    assert not refine._may_be(cameras, shaken(cameras, 40.0, 0.0))
    assert not refine._may_be(cameras, leapt)
    assert refine._may_be(cameras, shaken(cameras, 2.0, 0.02))


def test_adjusted_cameras_come_back_as_they_were_written(tmp_path):
    cameras = ring(5)
    moved = shaken(cameras, 2.0, 0.02)
    path = tmp_path / "cameras.json"
    assert adjusted(path, cameras) == tuple(cameras)
    write_adjusted(path, moved)
    for camera, expected in zip(adjusted(path, cameras), moved, strict=True):
        assert np.array_equal(camera.camera_to_world, expected.camera_to_world)
        assert camera.fx == expected.fx


@pytest.mark.parametrize("content", [
    "", "[]", "{}", '{"c0": 3}', '{"c0": [[1, 0], [0, 1]]}', '{"c0": [[1, 0, 0, "x"]]}',
    '{"c0": [[NaN, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}',
])  # fmt: skip
def test_a_broken_file_of_adjusted_cameras_is_one_sentence_that_names_it(tmp_path, content):
    path = tmp_path / "cameras.json"
    path.write_text(content)
    with pytest.raises(JobError, match=r"cameras\.json: the adjusted cameras cannot be read"):
        adjusted(path, ring(1))
