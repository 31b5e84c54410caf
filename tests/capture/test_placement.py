"""Which way is up, how big and where: captures stand upright whatever their file's world was."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from solver.capture.camera import Camera
from solver.capture.capture import Capture, region_seen_by
from solver.capture.placement import (
    SIZE,
    counted_from,
    estimate_up,
    placed,
    rotation_between,
    suggest_placement,
)


def look_at(position, roll=0.0, target=(0, 0, 0)):
    back = np.array(position, dtype=float) - target
    back /= np.linalg.norm(back)
    right = np.cross((0, 0, 1), back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3] = np.stack([right, np.cross(back, right), back, position], 1)
    matrix[:3, :3] = matrix[:3, :3] @ Rotation.from_euler("z", roll).as_matrix()
    return matrix


def ring(count=24, heights=(0.3, 1.2), roll=lambda i: 0.0):
    cameras = []
    for i in range(count):
        angle = 2 * np.pi * i / count
        height = heights[i % len(heights)]
        pose = look_at((3 * np.cos(angle), 3 * np.sin(angle), height), roll(i))
        cameras.append(Camera(f"c{i}", None, pose, 60, 40, 70.0, 70.0, 30.0, 20.0))
    return cameras


def capture_of(cameras, **more):
    return Capture(Path("x"), tuple(cameras), region_seen_by(cameras), **more)


def similarity(seed):
    rng = np.random.default_rng(seed)
    matrix = np.eye(4)
    matrix[:3, :3] = rng.uniform(0.1, 30) * Rotation.random(random_state=seed).as_matrix()
    matrix[:3, 3] = rng.normal(size=3) * 50
    return matrix


ROLLS = {
    "level": lambda i: 0.0,
    "shaky": lambda i: 0.12 * np.sin(7.0 * i),
    "portrait": lambda i: np.pi / 2,
    "mixed": lambda i: (0.0, np.pi / 2, -np.pi / 2)[i % 3],
    "mostly level": lambda i: np.pi / 2 if i % 5 == 0 else 0.05 * np.sin(i),
}


@pytest.mark.parametrize("roll", ROLLS.values(), ids=ROLLS)
@pytest.mark.parametrize("seed", range(3))
def test_up_is_found_within_two_degrees_in_any_world_and_however_photos_are_held(roll, seed):
    moved = placed(capture_of(ring(roll=roll)), similarity(seed))
    rotation = similarity(seed)[:3, :3]
    truth = rotation[:, 2] / np.linalg.norm(rotation[:, 2])
    assert estimate_up(list(moved.cameras)) @ truth > np.cos(np.radians(2))


def test_up_is_found_from_photos_that_all_lie_upside_down_in_their_files(tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 3
    Image.new("RGB", (8, 6)).save(tmp_path / "a.jpg", exif=exif)
    cameras = [replace(c, image_path=tmp_path / "a.jpg") for c in ring(roll=lambda i: math.pi)]
    assert estimate_up(cameras) @ [0, 0, 1] > 0.99
    Image.new("RGB", (8, 6)).save(tmp_path / "a.jpg")
    assert estimate_up(cameras) @ [0, 0, 1] < -0.99


def test_cameras_that_look_one_way_still_have_an_up():
    cameras = [
        Camera(f"c{i}", None, look_at((x, -3, 0.2), target=(x, 0, 0.2)), 60, 40, 70, 70, 30, 20)
        for i, x in enumerate(np.linspace(-1, 1, 6))
    ]
    assert estimate_up(cameras)[2] > 0.99


@pytest.mark.parametrize("seed", range(3))
def test_a_suggested_placement_undoes_an_unknown_world(seed):
    moved = placed(capture_of(ring()), similarity(seed))
    upright = placed(moved, suggest_placement(moved))
    assert estimate_up(list(upright.cameras))[2] > 0.999
    np.testing.assert_allclose(upright.region.mean(0), 0, atol=1e-3)
    np.testing.assert_allclose((upright.region[1] - upright.region[0]).max(), SIZE, rtol=1e-3)


def test_a_file_that_knows_up_and_scale_is_only_turned():
    capture = capture_of(ring(), up=np.array([0.0, 1.0, 0.0]), metric=True)
    matrix = suggest_placement(capture)
    np.testing.assert_allclose(matrix[:3, :3] @ (0, 1, 0), (0, 0, 1), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(matrix[:3, :3]), 1)
    np.testing.assert_allclose(matrix[:3, 3], 0)
    as_it_is = suggest_placement(capture_of(ring(), up=np.array([0.0, 0.0, 1.0])))
    np.testing.assert_allclose(as_it_is, np.eye(4), atol=1e-12)


def test_a_capture_at_the_other_end_of_the_world_is_moved_to_the_origin():
    far = [
        replace(c, camera_to_world=c.camera_to_world + np.array([[0, 0, 0, 5e5]] * 3 + [[0] * 4]))
        for c in ring()
    ]
    capture = capture_of(far, up=np.array([0.0, 0.0, 1.0]), metric=True)
    moved = placed(capture, suggest_placement(capture))
    assert np.abs(moved.region).max() < 10
    assert moved.metric


def test_a_placement_for_coordinates_from_another_origin_leads_to_the_same_place():
    matrix, origin = similarity(2), np.array([412345.0, 5212345.0, 120.0])
    point = np.array([0.3, -0.2, 0.1, 1.0])
    there = matrix @ (point + [*origin, 0])
    np.testing.assert_allclose(counted_from(matrix, origin) @ point, there, rtol=1e-12)


def test_placing_moves_cameras_points_and_what_they_project_to_alike():
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.4, 0.4, (200, 3))
    capture = capture_of(ring(), points=points)
    moved = placed(capture, similarity(1))
    for before, after in zip(capture.cameras, moved.cameras, strict=True):
        np.testing.assert_allclose(
            before.project(points)[0], after.project(moved.points)[0], atol=1e-6
        )


def test_without_masks_the_region_is_no_longer_than_the_views_are_wide(tmp_path):
    def edge(mode, mask=None):
        photo = tmp_path / f"{mode}.png"
        Image.new(mode, (4, 4)).save(photo)
        tall = [replace(c, width=30, height=90, image_path=photo, mask_path=mask) for c in ring()]
        return float(np.ptp(region_seen_by(tall), axis=0)[0])

    assert edge("RGB") == pytest.approx(1.2 / 3 * edge("RGBA"))
    assert edge("RGB", tmp_path / "mask.png") == pytest.approx(edge("RGBA"))


@pytest.fixture
def jpegs(tmp_path):
    """Cameras whose photos can have no alpha."""
    Image.new("RGB", (60, 40)).save(tmp_path / "a.jpg")
    return [replace(camera, image_path=tmp_path / "a.jpg") for camera in ring()]


def test_points_draw_the_region_closer_and_a_few_do_not(jpegs):
    rng = np.random.default_rng(0)
    cube = region_seen_by(jpegs)
    points = np.concatenate([rng.normal(0, 0.1, (500, 3)), rng.uniform(20, 30, (500, 3))])
    region = region_seen_by(jpegs, points)
    assert (region[1] - region[0]).max() < 0.8 * (cube[1] - cube[0]).max()
    assert (region[0] < -0.3).all() and (region[1] > 0.3).all()
    np.testing.assert_array_equal(region_seen_by(jpegs, points[:50]), cube)


def test_points_on_a_table_alone_leave_room_for_a_shiny_thing_on_it(jpegs, tmp_path):
    table = np.random.default_rng(1).uniform(-1, 1, (500, 3)) * [1, 1, 0.01]
    cube = region_seen_by(jpegs)
    region = region_seen_by(jpegs, table)
    half = (cube[1] - cube[0])[2] / 2
    assert region[1, 2] > 0.65 * half and region[0, 2] < -0.65 * half
    # Masks say it better: the object may reach as far as the views.
    masked = [replace(camera, mask_path=tmp_path / "mask.png") for camera in jpegs]
    np.testing.assert_array_equal(region_seen_by(masked, table), region_seen_by(masked))


@pytest.mark.parametrize("second", [(0, 0, 1), (0, 0, -1), (0, 1, 0), (0.6, 0, 0.8)])
def test_rotation_between_two_directions_takes_one_to_the_other(second):
    first, second = np.array([0.0, 0.0, 1.0]), np.array(second, dtype=float)
    rotation = rotation_between(first, second)
    np.testing.assert_allclose(rotation @ first, second, atol=1e-12)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(rotation), 1)
