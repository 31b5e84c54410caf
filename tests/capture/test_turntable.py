"""Objects that were turned: the axis from the cameras, and whether the light went round with them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from solver.capture.camera import Camera
from solver.capture.turntable import ON_STANDS, Turntable, stands_of, stands_still
from tests.capture.poses import look_at

WORLDS = {
    "upright": (Rotation.identity(), np.zeros(3), 1.0),
    "lying, far and large": (Rotation.random(random_state=4), np.array([80.0, -30.0, 9.0]), 25.0),
}
worlds = pytest.mark.parametrize("world", WORLDS.values(), ids=WORLDS)


def seen(pose, name="c"):
    return Camera(name, None, pose, 60, 40, 70.0, 70.0, 30.0, 20.0)


def turned_before_cameras(stands=((3, 0, 0.4), (2.4, 0, 1.8)), photos=15, shaken=0.0, span=1.0):
    """Cameras as a file has them whose object was turned once by +z before each stand."""
    rng, cameras = np.random.default_rng(2), []
    for stand in stands:
        for angle in 2 * np.pi * span * np.arange(photos) / photos:
            pose = np.eye(4)
            pose[:3, :3] = Rotation.from_rotvec((0, 0, angle)).as_matrix()
            pose = pose @ look_at(stand)
            pose[:3, :3] = Rotation.from_rotvec(shaken * rng.normal(size=3)).as_matrix() @ pose[:3, :3]
            pose[:3, 3] += shaken * rng.normal(size=3)
            cameras.append(seen(pose))
    return cameras


def moved(cameras, world):
    rotation, origin, scale = world
    poses = []
    for camera in cameras:
        pose = camera.camera_to_world.copy()
        pose[:3, :3] = rotation.as_matrix() @ pose[:3, :3]
        pose[:3, 3] = scale * rotation.apply(pose[:3, 3]) + origin
        poses.append(pose)
    return [seen(pose) for pose in poses]


def carried(count=60):
    """Cameras that somebody carried round an object, twice."""
    rng, cameras = np.random.default_rng(5), []
    for index in range(count):
        angle, height = 4 * np.pi * index / count, (0.5, 1.6)[2 * index // count]
        place = np.array([3 * np.cos(angle), 3 * np.sin(angle), height]) + rng.normal(0, 0.12, 3)
        cameras.append(seen(look_at(place, rng.normal(0, 0.03), rng.normal(0, 0.1, 3))))
    return cameras


@worlds
@pytest.mark.parametrize("shaken", [0.0, 0.003])
def test_the_axis_of_a_turntable_is_found_in_any_world(world, shaken):
    rotation, origin, scale = world
    found = stands_of(moved(turned_before_cameras(shaken=shaken), world))
    assert found.share == 1 and len(np.unique(found.of_photo)) == 2
    table = found.turntable
    tolerance = 1e-6 + 3 * shaken
    np.testing.assert_allclose(table.axis, rotation.apply((0, 0, 1)), atol=tolerance)
    away = (table.centre - origin) / scale
    np.testing.assert_allclose(np.cross(away, table.axis), 0, atol=tolerance)


@worlds
def test_light_beside_the_camera_turns_with_it(world):
    rotation = world[0]
    cameras = moved(turned_before_cameras(), world)
    table = stands_of(cameras).turntable
    for index, camera in enumerate(cameras):
        # A lamp that hangs to the right of the camera and above it, seen from the first stand.
        lamp = camera.camera_to_world[:3, :3] @ np.array([0.6, 0.5, 0.4])
        first = cameras[0 if index < 15 else 15].camera_to_world[:3, :3] @ np.array([0.6, 0.5, 0.4])
        np.testing.assert_allclose(table.turn_of(camera) @ first, lamp, atol=1e-6)
    np.testing.assert_allclose(table.turn_of(cameras[0]), np.eye(3), atol=1e-9)
    quarter = Turntable(*(rotation.apply(v) for v in ((0, 0, 1), (0, 0, 0), (1, 0, 0))))
    assert quarter.angle_of(rotation.apply((0.0, 2.0, 7.0))) == pytest.approx(np.pi / 2)


def test_a_turntable_moves_with_the_world_that_is_counted_from_elsewhere():
    origin = np.array([5.0, -2.0, 1.0])
    cameras = turned_before_cameras()
    table = stands_of(cameras).turntable
    other = table.seen_from(origin)
    for camera in cameras:
        np.testing.assert_allclose(
            other.turn_of(camera.seen_from(origin)), table.turn_of(camera), atol=1e-12
        )


def test_cameras_that_were_carried_stand_on_no_circles():
    assert stands_of(carried()).share < 0.5


def test_cameras_all_over_a_dome_stand_on_no_circles():
    rng, cameras = np.random.default_rng(0), []
    for _ in range(200):
        angle, z = rng.uniform(0, 2 * np.pi), rng.uniform(0.05, 0.95)
        across = np.sqrt(1 - z * z)
        cameras.append(seen(look_at(4 * np.array([across * np.cos(angle), across * np.sin(angle), z]))))
    assert stands_of(cameras).share < ON_STANDS


def test_photos_from_one_side_are_no_turn():
    found = stands_of(turned_before_cameras(photos=12, span=0.2))
    assert found is None or found.share == 0


def test_few_cameras_or_cameras_in_one_place_have_no_axis():
    cameras = turned_before_cameras()
    assert stands_of(cameras[:2]) is None
    assert stands_of([cameras[0]] * 30) is None


def test_a_camera_right_above_the_axis_has_a_turn_as_well():
    cameras = turned_before_cameras()
    above = np.eye(4)
    above[2, 3] = 3.0
    turn = stands_of(cameras).turntable.turn_of(seen(above))
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-9)


# Photos' edges.

STANDS = np.repeat([0, 8], 8)


def photos_of(behind, noise=2.0):
    """Photos of a thing that changes, [32, 48, 3] uint8, before what `behind(index)` [32, 48, 3] says."""
    rng, found = np.random.default_rng(1), []
    for index in range(len(STANDS)):
        photo = behind(index) + rng.normal(0, noise, (32, 48, 3))
        photo[8:24, 14:34] = rng.uniform(0, 255, 3)
        found.append(np.clip(photo, 0, 255).astype(np.uint8))
    return found


def room(seed):
    coarse = np.random.default_rng(seed).uniform(60, 200, (8, 12, 3))
    return np.kron(coarse, np.ones((4, 4, 1)))


LEFT_IS_BRIGHTER = np.broadcast_to(np.linspace(140, 110, 48)[None, :, None], (32, 48, 3))
LIKE_A_SKY = np.broadcast_to(np.linspace(220, 60, 32)[:, None, None], (32, 48, 3))
PLAIN = np.full((32, 48, 3), 128.0)


def test_a_studio_stands_still_behind_a_turntable():
    assert stands_still(photos_of(lambda i: LEFT_IS_BRIGHTER), STANDS) is True
    # From another height it looks different.
    assert stands_still(photos_of(lambda i: room(i // 8)), STANDS) is True


def test_a_room_moves_past_a_camera_on_a_circle():
    assert stands_still(photos_of(room), STANDS) is False


@pytest.mark.parametrize("behind", [PLAIN, LIKE_A_SKY], ids=["plain", "like a sky"])
def test_what_looks_alike_from_all_sides_tells_nothing(behind):
    assert stands_still(photos_of(lambda i: behind, noise=0.5), STANDS) is None


def test_photos_that_share_no_stand_or_size_tell_nothing():
    still = photos_of(lambda i: LEFT_IS_BRIGHTER)
    assert stands_still(still, np.full(len(still), -1)) is None
    still[3] = still[3][:, :40]
    assert stands_still(still[:8], STANDS[:8]) is None


def test_no_side_is_zero_for_cameras_on_the_axis_itself():
    camera = turned_before_cameras()[0]
    above = camera.camera_to_world.copy()
    above[:3] = np.c_[np.eye(3), (0, 0, 3)]
    spun = []
    for angle in np.linspace(0, 2 * np.pi, 12, endpoint=False):
        pose = above.copy()
        pose[:3, :3] = Rotation.from_rotvec((0, 0, angle)).as_matrix()
        spun.append(replace(camera, camera_to_world=pose))
    assert stands_of(spun) is None
