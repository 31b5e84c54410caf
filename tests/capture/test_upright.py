"""Which way is up, from how cameras are held: in any world, all around or from one side."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from solver.capture.capture import Capture, region_seen_by
from solver.capture.orientation import UPWARD, oriented
from solver.capture.placement import placed
from solver.capture.upright import estimate_up, up_of
from tests.capture.poses import camera_at, look_at, ring, similarity

ROLLS = {
    "level": lambda i: 0.0,
    "shaky": lambda i: 0.12 * np.sin(7.0 * i),
    "portrait": lambda i: np.pi / 2,
    "mixed": lambda i: (0.0, np.pi / 2, -np.pi / 2)[i % 3],
    "mostly level": lambda i: np.pi / 2 if i % 5 == 0 else 0.05 * np.sin(i),
}


def degrees_off(cameras, truth=(0, 0, 1)):
    return math.degrees(math.acos(np.clip(estimate_up(cameras) @ truth, -1, 1)))


def arc(degrees, slope, roll, seed, count=24, shake=3.0):
    """Cameras by hand around the origin, looking down by `slope` degrees; path None."""
    rng = np.random.default_rng(seed)
    shakes = np.radians(rng.normal(0, shake, (count, 3)))
    cameras = []
    for i, (nod, turn, sway) in enumerate(shakes):
        angle = np.radians(degrees) * i / (count - 1) + turn
        down = np.radians(slope) + nod
        position = 3 * np.array([np.cos(angle) * np.cos(down), np.sin(angle) * np.cos(down), np.sin(down)])
        pose = look_at(position, roll(i) + sway)
        cameras.append(camera_at(pose, f"c{i}"))
    return cameras


@pytest.mark.parametrize("roll", ROLLS.values(), ids=ROLLS)
@pytest.mark.parametrize("seed", range(3))
def test_up_is_found_within_two_degrees_in_any_world_and_however_photos_are_held(roll, seed):
    cameras = ring(roll=roll)
    capture = Capture(Path("x"), tuple(cameras), region_seen_by(cameras))
    moved = placed(capture, similarity(seed))
    rotation = similarity(seed)[:3, :3]
    truth = rotation[:, 2] / np.linalg.norm(rotation[:, 2])
    assert degrees_off(list(moved.cameras), truth) < 2


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("slope", [5, 30, 60])
@pytest.mark.parametrize("degrees", [40, 90, 180])
@pytest.mark.parametrize("roll", [ROLLS["level"], ROLLS["mixed"]], ids=["level", "mixed"])
def test_photos_from_one_side_have_an_up(roll, degrees, slope, seed):
    assert degrees_off(arc(degrees, slope, roll, seed)) < (8 if degrees == 40 else 5)


def test_few_photos_have_an_up():
    assert max(degrees_off(arc(60, 20, ROLLS["level"], seed, count=4)) for seed in range(5)) < 15


def test_photos_from_below_to_above_have_an_up():
    cameras = [
        camera_at(look_at((3 * np.cos(a), 0.1 * i, 3 * np.sin(a))))
        for i, a in enumerate(np.radians(np.linspace(0, 70, 12)))
    ]
    assert degrees_off(cameras) < 25


def test_cameras_that_look_one_way_still_have_an_up():
    cameras = [camera_at(look_at((x, -3, 0.2), target=(x, 0, 0.2))) for x in np.linspace(-1, 1, 6)]
    assert degrees_off(cameras) < 8


def test_cameras_that_all_stand_in_one_place_and_look_alike_have_their_own_up():
    assert degrees_off([camera_at(look_at((0, -3, 0.0)))] * 3) < 8


def test_a_file_that_says_what_is_up_is_believed():
    cameras = ring()
    capture = Capture(Path("x"), tuple(cameras), region_seen_by(cameras), up=np.array([0.0, 2.0, 0.0]))
    np.testing.assert_allclose(up_of(capture), (0, 1, 0))


def test_up_is_found_from_photos_that_all_lie_upside_down_in_their_files(tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 3
    Image.new("RGB", (8, 6)).save(tmp_path / "a.jpg", exif=exif)
    cameras = [replace(c, image_path=tmp_path / "a.jpg") for c in ring(roll=lambda i: math.pi)]
    assert degrees_off(cameras) < 5
    Image.new("RGB", (8, 6)).save(tmp_path / "a.jpg")
    assert degrees_off(cameras) > 175


@pytest.mark.parametrize("orientation, roll", [(6, -math.pi / 2), (8, math.pi / 2)])
def test_portrait_photos_from_one_side_have_the_up_that_their_headers_say(orientation, roll, tmp_path):
    exif = Image.Exif()
    exif[0x0112] = orientation
    Image.new("RGB", (60, 40)).save(tmp_path / "a.jpg", exif=exif)
    lying = [replace(c, image_path=tmp_path / "a.jpg") for c in arc(60, 10, lambda i: roll, seed=0)]
    assert degrees_off(lying) < 5
    upright = [  # of programs that turn the photo first
        replace(c, image_path=tmp_path / "a.jpg", width=40, height=60)
        for c in arc(60, 10, ROLLS["level"], seed=0)
    ]
    assert degrees_off(upright) < 5


@pytest.mark.parametrize("orientation", range(1, 9))
def test_up_in_a_file_is_where_the_turned_photos_upper_edge_comes_from(orientation):
    row, column = np.mgrid[0:5, 0:7]
    x, y = oriented(np.stack([column - 3, 2 - row], -1), orientation)[0].mean(0)
    assert tuple(np.sign([x, y])) == UPWARD.get(orientation, (0, 1))


def test_the_sign_follows_upright_photos_where_others_lie_on_their_sides():
    assert max(degrees_off(arc(40, 2, ROLLS["mixed"], seed)) for seed in range(8)) < 15


def test_many_cameras_are_judged_by_some():
    cameras = ring(count=1300, roll=ROLLS["shaky"])
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("xyz", (1.0, 2.0, 3.0)).as_matrix()
    capture = Capture(Path("x"), tuple(cameras), region_seen_by(cameras))
    assert degrees_off(list(placed(capture, turn).cameras), turn[:3, 2]) < 1
