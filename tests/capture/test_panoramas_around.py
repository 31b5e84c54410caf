"""What panoramas around an object tell of it: where it is, which way is up, and what photos have in common."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.ndimage
from scipy.spatial.transform import Rotation

from solver.capture.camera import Camera
from solver.capture.capture import Capture, region_seen_by
from solver.capture.panorama import Comparison, panorama_of
from solver.capture.panoramic_lens import EQUIRECTANGULAR, of_whole_sphere
from solver.capture.photo_matches import neighbours, picture_from
from solver.capture.triangulate import triangulate
from solver.capture.upright import estimate_up
from solver.fit.visual_hull import carve, cell_centres, hull_box
from solver.preflight.coverage import coverage, looking_away
from solver.preflight.looks import _longer_side, frame_of
from tests.capture.far_scene import far_colour
from tests.capture.poses import ring
from tests.capture.printed_table import camera_at, printed

RADIUS = 0.5
TEXEL = 0.02


def panorama(camera, width=128, height=64, turn=0.0):
    """A panorama from where a camera stands and as that is held, but turned about the vertical."""
    pose = camera.camera_to_world.copy()
    pose[:3, :3] = Rotation.from_rotvec([0, 0, turn]).as_matrix() @ pose[:3, :3]
    return replace(
        camera, width=width, height=height, lens=EQUIRECTANGULAR, distortion=(),
        camera_to_world=pose, **dict(zip(("fx", "fy", "cx", "cy"), of_whole_sphere(width, height), strict=True)),
    )  # fmt: skip


def upright_panoramas(count=12, height=0.6, seed=0, width=128):
    """Panoramas on a circle of radius 2 around the vertical, held upright, turned by chance."""
    cameras, rng = [], np.random.default_rng(seed)
    for angle in np.linspace(0, 2 * np.pi, count, endpoint=False):
        pose = np.eye(4)
        # Ahead is −Z of the camera, so level cameras have +Z of the world as their +Y.
        turn = Rotation.from_euler("ZX", (rng.uniform(0, 360), 90), degrees=True)
        pose[:3, :3] = turn.as_matrix()
        pose[:3, 3] = 2 * np.cos(angle), 2 * np.sin(angle), height
        cameras.append(panorama(Camera(f"c{angle:.2f}", None, pose, 8, 8, 8, 8, 4, 4), width, width // 2))
    return cameras


def rays_of(camera):
    row, column = np.mgrid[: camera.height, : camera.width] + 0.5
    return camera.rays(column.ravel(), row.ravel())


def mask_of_ball(camera):
    origins, directions = rays_of(camera)
    closest = np.linalg.norm(np.cross(origins, directions), axis=1)
    ahead = (origins * directions).sum(1) < 0
    return ((closest < RADIUS) & ahead).reshape(camera.height, camera.width)


@pytest.fixture(scope="module")
def around():
    return upright_panoramas()


def test_the_region_is_around_the_middle_of_panoramas_wherever_their_pictures_begin(around):
    region = region_seen_by(around)
    np.testing.assert_allclose(region.mean(0), [0, 0, 0.6], atol=1e-9)
    assert (np.abs(region - region.mean(0)) > RADIUS).all()
    # Cameras with an axis tell more.
    mixed = [*ring(8), *around]
    np.testing.assert_allclose(region_seen_by(mixed), region_seen_by(ring(8)))


def test_up_is_that_of_panoramas_whatever_is_in_their_middle(around):
    np.testing.assert_allclose(estimate_up(around), [0, 0, 1], atol=1e-6)
    tilt = Rotation.from_rotvec([0.5, -0.3, 0.2]).as_matrix()
    turned = np.eye(4)
    turned[:3, :3] = tilt
    same_way = [replace(c, camera_to_world=around[0].camera_to_world) for c in around]
    for cameras in (around, same_way):
        up = estimate_up([camera.placed(turned) for camera in cameras])
        np.testing.assert_allclose(up, tilt[:, 2], atol=1e-6)


def test_no_panorama_looks_away(around):
    capture = Capture("memory", tuple(around), region_seen_by(around))
    assert looking_away(capture) == []
    assert not any("do not see the region" in finding.text for finding in coverage(capture))


def test_masks_of_panoramas_tell_the_objects_bounds_also_across_the_seam(around):
    masks = [mask_of_ball(camera) for camera in around]
    # Some panorama has the ball across its seam, and some has not.
    cut = [mask[:, 0].any() and mask[:, -1].any() for mask in masks]
    assert 0 < sum(cut) < len(cut)
    box = hull_box(around, lambda: masks, region_seen_by(around), 32)
    assert (np.abs(box[:, :2]) < RADIUS + 0.15).all() and (np.abs(box) >= RADIUS - 0.05).all()
    region = np.array([[-1.0] * 3, [1.0] * 3])
    hull = carve(around, masks, region, 32, whole_cells=True).ravel()
    # A pixel is a tenth of a unit wide there.
    assert hull[np.linalg.norm(cell_centres(region, 32), axis=1) < RADIUS - 0.1].all()


def test_of_a_ball_steeply_below_panoramas_no_cell_is_lost():
    cameras = upright_panoramas(height=4.0, width=64)
    masks = [mask_of_ball(camera) for camera in cameras]
    region = np.array([[-1.0] * 3, [1.0] * 3])
    hull = carve(cameras, masks, region, 8, whole_cells=True).ravel()
    assert hull[np.linalg.norm(cell_centres(region, 8), axis=1) < RADIUS].all()


def test_a_mask_across_the_seam_is_one_piece():
    camera = panorama(ring(1)[0])
    mask = np.zeros((64, 128), bool)
    mask[30:34, :5] = mask[30:34, -6:] = True
    assert _longer_side(mask, camera) == 11
    assert _longer_side(np.roll(mask, 40, axis=1), camera) == 11
    assert _longer_side(mask | True, camera) == 128 and _longer_side(mask & False, camera) == 0


def test_the_frame_of_a_region_across_the_seam_is_the_whole_photo(around):
    region = np.array([[-0.4] * 3, [0.4] * 3])
    for camera in around:
        rows, columns = frame_of(camera, region, 1.0, (64, 128))
        shown = np.zeros((64, 128), bool)
        shown[rows, columns] = True
        (row, column), inside, _ = camera.pixels_of(cell_centres(region, 8), (64, 128))
        assert inside.all() and shown[row, column].all()


def test_a_scale_counts_along_a_row_also_where_it_is_steep():
    camera = panorama(ring(1)[0])
    down, right = -camera.camera_to_world[:3, 1], camera.camera_to_world[:3, 0]
    for steep in (0.0, 0.5, 1.2):
        ahead = np.cos(steep) * camera.view_direction + np.sin(steep) * down
        points = camera.position + 3 * ahead + np.array([[-5e-4], [5e-4]]) * right
        pixels, depth = camera.project(points)
        scale = camera.fx / camera.depths_of_scale(points, depth)
        np.testing.assert_allclose(np.ptp(pixels[:, 0]) / 1e-3, scale, rtol=1e-3)


def test_panoramas_of_what_is_far_agree_also_at_the_seam(around):
    colours = [far_colour(rays_of(camera)[1]).reshape(64, 128, 3) for camera in around]
    nothing = [np.zeros((64, 128), bool)] * len(around)
    found = Comparison(around, colours).agreement(0)
    assert (found.seen == len(around) - 1).all()
    assert found.is_far[:, [0, -1]].mean() > 0.95 and found.is_far.mean() > 0.95
    assert panorama_of(around, colours, nothing).known.mean() > 0.99


def table_picture(camera, pattern):
    """A printed table below in the dark."""
    origins, directions = rays_of(camera)
    place = origins - directions * (origins[:, 2:] / directions[:, 2:])
    at = place[:, :2] / TEXEL + 0.5 * len(pattern) - 0.5
    seen = scipy.ndimage.map_coordinates(pattern, at.T, order=1, cval=0.0)
    grey = np.where(directions[:, 2] < 0, 255 * seen + 0.5, 0).astype(np.uint8)
    return picture_from(np.repeat(grey.reshape(camera.height, camera.width, 1), 3, axis=2))


@pytest.mark.parametrize("turn", [0.0, np.pi])
def test_points_lie_on_what_panoramas_show_before_and_behind_them(turn):
    pattern = printed()
    cameras = [panorama(camera_at(a), 800, 400, turn) for a in np.linspace(0, 1.2, 6)]
    pictures = [table_picture(camera, pattern) for camera in cameras]
    found = triangulate(cameras, pictures, lambda done: None)
    assert found.beside < 0.5 and found.remedy is None
    # A pixel is 2 cm wide there.
    assert len(found.points) > 100 and np.percentile(np.abs(found.points[:, 2]), 90) < 0.08


def test_panoramas_are_compared_by_how_near_they_are_wherever_their_pictures_begin():
    ahead = [camera_at(angle, height=0.0) for angle in (0.0, np.pi)]
    assert neighbours(ahead) == []
    assert neighbours([panorama(camera) for camera in ahead]) == [(0, 1)]
