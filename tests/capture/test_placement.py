"""Which way is up, how big and where: captures stand upright whatever their file's world was."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from solver.capture.capture import Capture, region_seen_by
from solver.capture.placement import (
    SIZE,
    counted_from,
    placed,
    rotation_between,
    suggest_placement,
)
from solver.capture.upright import estimate_up
from tests.capture.poses import ring, similarity


def capture_of(cameras, **more):
    return Capture(Path("x"), tuple(cameras), region_seen_by(cameras), **more)


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
        np.testing.assert_allclose(before.project(points)[0], after.project(moved.points)[0], atol=1e-6)


def test_a_region_that_a_file_states_moves_along_and_any_other_is_found_anew():
    own = capture_of(ring(8))
    box = np.array([[-0.2, -0.1, 0.0], [0.4, 0.1, 0.3]])
    matrix = similarity(3)
    moved = placed(replace(own, region=box), matrix).region
    corners = np.stack(np.meshgrid(*box.T, indexing="ij"), -1).reshape(-1, 3)
    corners = corners @ matrix[:3, :3].T + matrix[:3, 3]
    np.testing.assert_allclose(moved, [corners.min(0), corners.max(0)], atol=1e-9)
    np.testing.assert_allclose(placed(replace(own, region=box), np.eye(4)).region, box, atol=1e-12)
    found = placed(own, matrix)
    np.testing.assert_allclose(found.region, region_seen_by(list(found.cameras)), atol=1e-12)


def test_without_masks_the_region_is_no_longer_than_the_views_are_wide(tmp_path):
    def edge(mode, mask=None):
        photo = tmp_path / f"{mode}.png"
        Image.new(mode, (4, 4)).save(photo)
        cameras = ring(heights=(0.8,))
        tall = [replace(c, width=30, height=90, image_path=photo, mask_path=mask) for c in cameras]
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
