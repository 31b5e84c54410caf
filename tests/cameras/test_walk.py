"""Cameras of a walk that leap are found, and placed where neighbours' matches have them."""

import json
import shutil
from functools import partial

import numpy as np
import pytest
from PIL import Image

from solver.cameras import command
from solver.cameras.walk import LEAP, leaps, off_epipolar
from solver.capture.read import read_capture
from solver.cli import main
from tests.cameras.box_scene import BoxScene, align, box_camera, orbit

SMALL = 300
"""longer side, in pixels, at which these tests find features: a fifth of the time that the usual 800 take"""


def circle(count=40, degrees=330.0, first=0):
    angles = np.radians(np.linspace(0, degrees, count))
    ring = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    return {first + i: position for i, position in enumerate(ring)}


def test_a_walk_around_has_no_leaps_nor_one_with_stops_and_gaps():
    assert leaps(circle(), 1.0) == []
    stopped = dict(enumerate(np.repeat(np.stack(list(circle(20).values())), 5, axis=0)))
    assert leaps(stopped, 1.0) == []
    gaps = {number: step for number, step in circle().items() if not 10 <= number < 16}
    assert leaps(gaps, 1.0) == []


def test_a_few_photos_far_apart_do_not_leap():
    assert leaps(circle(8), 1.0) == []


def test_the_photo_to_which_a_camera_leaps_is_named():
    folded = {n: step * (1 if n < 25 else -1) for n, step in circle(first=1).items()}
    assert leaps(folded, 1.0) == [25]
    astray = circle()
    astray[38], astray[39] = astray[18], astray[19]
    assert leaps(astray, 1.0) == [38]


def test_a_small_step_is_no_leap_however_slow_the_walk():
    slow = {n: np.array([1e-4 * n, 0, 0]) for n in range(30)}
    slow[29] = np.array([1e-4 * 28 + 2 * LEAP * 1e-4, 0, 0])
    assert leaps(slow, 1.0) == []


def test_matched_rays_lie_in_epipolar_planes_of_the_true_poses_and_not_of_others():
    random = np.random.default_rng(0)
    points = random.uniform(-1, 1, (200, 3)) + [0, 0, 5]
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    between = np.concatenate([turn, [[0.4], [-0.2], [0.1]]], axis=1)
    seen = points @ between[:, :3].T + between[:, 3]

    def rays(where):
        return where / np.linalg.norm(where, axis=1, keepdims=True)

    assert off_epipolar(rays(points), rays(seen), between).max() < 1e-9
    off = np.median(off_epipolar(rays(points), rays(seen[::-1]), between))
    assert off > 0.05
    # Turned by an angle about the normal's own plane, a ray is off by that angle at most.
    angle = np.radians(3)
    twist = np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])
    turned = off_epipolar(rays(points), rays(seen) @ twist.T, between)
    assert 1e-4 < np.median(turned) <= np.sin(angle) and turned.max() <= np.sin(angle) + 1e-9


def _turned(texture, *axes):
    """A texture about its texel 0, as it is mirrored along axes."""
    return np.roll(np.flip(texture, axes), 1, axes)


@pytest.fixture(scope="module")
def alike(tmp_path_factory):
    """A walk around a box in a world that looks the same from opposite sides; and its true cameras."""
    folder = tmp_path_factory.mktemp("alike")
    scene = BoxScene()
    for plane in (0, 5):  # floor and top
        texture = scene.textures[plane]
        scene.textures[plane] = np.maximum(texture, _turned(texture, 0, 1))
    for one, other in ((1, 2), (3, 4)):
        scene.textures[other] = _turned(scene.textures[one], 0)
        scene.tints[other] = scene.tints[one]
    cameras = []
    for index, pose in enumerate(orbit(36, 350.0)):
        camera = box_camera(pose, f"IMG_{index:03d}", scale=0.5)
        Image.fromarray(scene.photo(camera)[0]).save(folder / f"{camera.name}.jpg", quality=95)
        cameras.append(camera)
    return folder, cameras


def position_error(capture, truth):
    """Largest distance to the true positions, as a share of their size, and warnings."""
    by_name = {camera.name: camera.position for camera in capture.cameras}
    found = np.stack([by_name[camera.name] for camera in truth])
    positions = np.stack([camera.position for camera in truth])
    scale, rotation, shift = align(found, positions)
    size = np.linalg.norm(positions - positions.mean(0), axis=1).max()
    return np.linalg.norm(scale * found @ rotation.T + shift - positions, axis=1).max() / size


@pytest.fixture
def solve(monkeypatch, capsys):
    """Solves on the command line, features found in small pictures; returns stderr and the lines of events."""
    small = partial(command.request_of, max_image_size=SMALL)
    monkeypatch.setattr(command, "request_of", small)

    def solve(photos, out):
        assert main(["solve", str(photos), "--out", str(out)]) == 0, capsys.readouterr().err
        return capsys.readouterr().err, (out / "events.jsonl").read_text().splitlines()

    return solve


def test_photos_around_what_looks_alike_from_behind_are_not_folded(alike, tmp_path, solve):
    folder, truth = alike
    _, events = solve(folder, tmp_path / "cameras")
    capture = read_capture(tmp_path / "cameras", photos=folder)
    assert len(capture.cameras) == len(truth)
    assert position_error(capture, truth) < 0.05
    overall = [e["overall"] for e in map(json.loads, events) if e["ev"] == "progress"]
    assert overall == sorted(overall) and overall[-1] == 1.0
    assert any("contradict each other" in line for line in events)


def test_one_is_told_where_names_are_no_order_that_could_tell_what_looks_alike(alike, tmp_path, solve):
    folder, truth = alike
    shuffled, some = tmp_path / "photos", truth[:20]
    shuffled.mkdir()
    order = np.random.default_rng(1).permutation(len(some))
    for camera, number in zip(some, order, strict=True):
        shutil.copy(folder / f"{camera.name}.jpg", shuffled / f"IMG_{number:03d}.jpg")
    told, _ = solve(shuffled, tmp_path / "cameras")
    assert "name photos in the order in which they were taken" in told
