"""The cube that a fit takes place in, around objects that stand askew in their world."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from solver.asset.from_scene import SceneSurface
from solver.asset.surface import marching_cubes
from solver.capture.camera import Camera
from solver.capture.capture import Capture, region_seen_by
from solver.capture.photos import Photo
from solver.fit.box import Box, box_around_hull
from solver.fit.settings import overridden
from solver.fit.start import BOXED, masks_of, new_trainer
from solver.fit.visual_hull import bounding_box, whole_hull
from solver.render.image import render_view
from solver.render.scene import StepTables
from tests.capture.poses import look_at
from tests.fit.test_fit import SMALL, resumed
from tests.fit.test_simplest_axes import off

TURNED = overridden(SMALL, "field.turn_box", "yes")
SIZE = 64
AXES = Rotation.from_rotvec([0.4, -0.3, 0.5]).as_matrix()
PLACE = np.array([0.3, -0.2, 0.1])
LOW, HIGH = np.array([-0.7, -0.4, -0.25]), np.array([0.7, 0.4, 0.25])
REGION = np.array([[-1.2] * 3, [1.6] * 3])


def askew_brick(axes=AXES, views=24):
    """Photos, with alpha, of a brick [LOW, HIGH] along axes, its middle at PLACE, from all around.

    Cameras are turned with it."""
    cameras, photos = [], []
    for number in range(views):
        z = 1 - 2 * (number + 0.5) / views
        angle = 2.4 * number
        back = np.array([np.cos(angle) * (1 - z * z) ** 0.5, np.sin(angle) * (1 - z * z) ** 0.5, z])
        right = np.cross((0.1, 0.2, 0.97), back)
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3] = axes.T @ np.stack([right, np.cross(back, right), back, 4 * back], axis=1)
        pose[:3, 3] += PLACE
        camera = Camera(f"r_{number}", None, pose, SIZE, SIZE, 110.0, 110.0, SIZE / 2, SIZE / 2)
        alpha = shown_by(camera, axes)
        pixels = np.repeat(alpha[..., None], 4, axis=2) * np.float32([0.5, 0.3, 0.2, 1])
        cameras.append(camera)
        photos.append(Photo(pixels.astype(np.float32), True, False))
    return Capture("memory", tuple(cameras), REGION), photos


def shown_by(camera, axes, place=PLACE, low=LOW, high=HIGH):
    """[SIZE, SIZE] bool: where a camera shows a brick."""
    row, column = np.mgrid[:SIZE, :SIZE]
    origins, directions = camera.rays(column.ravel() + 0.5, row.ravel() + 0.5)
    origins, directions = (origins - place) @ axes.T, directions @ axes.T
    ends = np.stack([(low - origins) / directions, (high - origins) / directions])
    return (ends.min(0).max(1) < ends.max(0).min(1)).reshape(SIZE, SIZE)


def boxed(region=REGION, turn=True, axes=AXES):
    capture, photos = askew_brick(axes)
    return box_around_hull(list(capture.cameras), lambda: masks_of(photos), region, 0.08, turn)


def in_brick(points, margin=0.0):
    """Which of world points [N, 3] are in the brick, or no further from it than a margin."""
    local = (points - PLACE) @ AXES.T
    return ((local >= LOW - margin) & (local <= HIGH + margin)).all(axis=1)


@pytest.mark.parametrize("overviews", [0, 12])
def test_a_long_object_of_which_most_photos_show_a_part_is_whole_in_the_box(overviews):
    half, cameras = np.array([0.08, 0.08, 1.0]), []
    for number in range(48):
        angle, close = 2.4 * number, number >= overviews
        target = np.array([0.0, 0.0, 0.9 * np.cos(1.7 * number)]) * close
        back = 1.6 if close else 4.0
        place = target + back * np.array([np.cos(angle), np.sin(angle), 0.3 * np.sin(number)])
        pose = look_at(place, target=target)
        cameras.append(Camera(f"r_{number}", None, pose, SIZE, SIZE, 90.0, 90.0, SIZE / 2, SIZE / 2))
    masks = [shown_by(camera, np.eye(3), np.zeros(3), -half, half) for camera in cameras]
    box = box_around_hull(cameras, lambda: masks, region_seen_by(cameras), 0.08, False)
    assert (box.world[0] < -half).all() and (box.world[1] > half).all() and box.half_size < 1.5


def test_what_few_photos_have_in_their_frames_is_not_in_the_hull():
    half, cameras = np.array([0.08, 0.08, 1.0]), []
    for number in range(24):
        angle, height = 2.4 * number, np.cos(1.7 * number)
        pose = look_at((4 * np.cos(angle), 4 * np.sin(angle), 2 * height))
        cameras.append(Camera(f"r_{number}", None, pose, SIZE, SIZE, 110.0, 110.0, SIZE / 2, SIZE / 2))
    masks = [shown_by(camera, np.eye(3), np.zeros(3), -half, half) for camera in cameras]
    cube = np.array([[-1.8] * 3, [1.8] * 3])
    for cells in whole_hull(cameras, lambda: masks, cube, 48):
        found = bounding_box(cells, cube)
        assert (np.abs(found) < half + 0.2).all() and (np.abs(found)[:, 2] > 0.95).all()


def test_the_box_around_an_askew_brick_has_its_axes_and_just_holds_it():
    box, unturned, straight = boxed(), boxed(turn=False), boxed(axes=np.eye(3))
    assert unturned.axes is None and straight.axes is None and off(box.axes, AXES) < 3
    np.testing.assert_allclose(box.centre, PLACE, atol=0.03)
    assert box.half_size == pytest.approx(straight.half_size, rel=0.03)
    assert box.half_size < 0.95 * unturned.half_size
    # Their worlds agree on where it is.
    low, high = box.world
    corners = PLACE + np.array([LOW, HIGH])[[0, 1, 1], [0, 1, 2]] @ AXES
    assert (corners >= low).all() and (corners <= high).all()


def test_of_a_brick_that_a_region_cuts_the_box_holds_what_is_in_the_region():
    region = REGION.copy()
    region[1, 0] = PLACE[0] - 0.1
    cut, whole = boxed(region), boxed()
    assert cut.half_size < 0.9 * whole.half_size and cut.centre[0] < whole.centre[0] - 0.15


def test_where_photos_are_from_one_side_their_views_turn_no_box():
    """The hull is long along them, and a cube that has its axes would be half as large again."""
    capture, photos = askew_brick(np.eye(3), 200)
    side = np.array([0.6, 0.5, 0.62]) / np.linalg.norm([0.6, 0.5, 0.62])
    near = [(c.position - PLACE) @ side > 4 * np.cos(np.radians(25)) for c in capture.cameras]
    cameras = [c for c, some in zip(capture.cameras, near, strict=True) if some]
    photos = [p for p, some in zip(photos, near, strict=True) if some]
    assert 8 < len(cameras) < 16
    box = box_around_hull(cameras, lambda: masks_of(photos), REGION, 0.08, True)
    assert box.axes is None


def test_a_fit_starts_as_the_brick_where_it_is_and_goes_on_as_it_was_from_a_checkpoint(tmp_path):
    capture, photos = askew_brick()
    trainer = new_trainer(capture, photos, TURNED, 0, None, "cpu", lambda fraction: None)
    field = trainer.scene.field
    assert off(field.axes.numpy(), AXES) < 3
    points = PLACE + np.random.default_rng(0).uniform(-0.9, 0.9, (4000, 3))
    inside, outside = in_brick(points, -0.08), ~in_brick(points, 0.1)
    with torch.no_grad():
        raw = field.raw_density(field.to_box(torch.from_numpy(points).float())).numpy()
    assert (raw[inside] > 2).mean() > 0.97 and (raw[outside] < -2).mean() > 0.97

    other, _ = resumed(trainer, tmp_path, capture, photos)
    torch.testing.assert_close(other.scene.field.axes, field.axes, rtol=0, atol=0)
    start, again = (
        render_view(scene, StepTables.of(scene), SMALL.render, capture.cameras[3]).opacity
        for scene in (trainer.scene, other.scene)
    )
    np.testing.assert_allclose(start, again, atol=1e-6)


def test_cameras_see_a_turned_start_as_they_do_a_straight_one():
    views, wrong = {}, {}
    for name, axes in (("turned", AXES), ("straight", np.eye(3))):
        capture, photos = askew_brick(axes)
        trainer = new_trainer(capture, photos, TURNED, 0, None, "cpu", lambda fraction: None)
        view = render_view(trainer.scene, StepTables.of(trainer.scene), SMALL.render, capture.cameras[3])
        views[name] = view
        wrong[name] = ((view.opacity > 0.5) != (photos[3].pixels[..., 3] > 0.5)).mean()
    assert wrong["turned"] < wrong["straight"] + 0.01 < 0.08
    shown = (views["turned"].opacity > 0.9) & (views["straight"].opacity > 0.9)
    apart = views["turned"].normal @ AXES.T - views["straight"].normal
    assert shown.mean() > 0.05 and np.median(np.linalg.norm(apart[shown], axis=1)) < 0.05


def test_the_mesh_of_a_turned_box_is_where_the_object_is_in_the_world():
    capture, photos = askew_brick()
    trainer = new_trainer(capture, photos, TURNED, 0, None, "cpu", lambda fraction: None)
    surface = SceneSurface(trainer.scene, list(capture.cameras))
    mesh = marching_cubes(surface, 62, 20.0)
    local = (mesh.vertices - PLACE) @ AXES.T
    np.testing.assert_allclose(local.min(0), LOW, atol=0.09)
    np.testing.assert_allclose(local.max(0), HIGH, atol=0.09)
    assert mesh.volume > 0


def test_a_box_is_that_of_the_field_made_in_it():
    box = Box(np.array([1.0, 2.0, 3.0]), 0.5, AXES)
    field = box.new_field(16)
    found = Box.of(field)
    np.testing.assert_allclose(found.axes, AXES, atol=1e-6)
    np.testing.assert_allclose(found.world, box.world, atol=1e-6)
    corners = field.from_box(torch.cartesian_prod(*[torch.tensor([0.0, 1.0])] * 3)).numpy()
    np.testing.assert_allclose([corners.min(0), corners.max(0)], box.world, atol=1e-5)
    np.testing.assert_allclose(
        [(corners @ AXES.T).min(0), (corners @ AXES.T).max(0)], box.along_axes, atol=1e-5
    )
    back = field.to_box(torch.from_numpy(corners))
    torch.testing.assert_close(back, back.round(), atol=1e-5, rtol=0)


def test_a_setting_keeps_the_box_straight():
    capture, photos = askew_brick()
    settings = overridden(SMALL, "field.turn_box", "no")
    trainer = new_trainer(capture, photos, settings, 0, None, "cpu", lambda fraction: None)
    assert trainer.scene.field.axes is None


class Asked(Exception):
    """To stop."""


def test_a_fit_can_be_stopped_while_its_box_is_turned():
    capture, photos = askew_brick()
    told = []

    def progress(done):
        told.append(done)
        if 0.1 < done < BOXED:
            raise Asked

    with pytest.raises(Asked):
        new_trainer(capture, photos, TURNED, 0, None, "cpu", progress)
    assert len(told) > 20 and told == sorted(told)
