"""How a camera has to move so that what is rendered looks like its photo."""

import numpy as np
import pytest
from scipy import ndimage

from solver.fit.image_alignment import DEPTH_BLUR, LEAST_OPACITY, comparable, evidence, moved
from solver.fit.ray_bank import camera_space_directions
from tests.fit.painted_ball import AWAY, RADIUS, camera_at, picture_of

LENSES = {
    "pinhole": (), "opencv": (-0.2, 0.05, 0.002, -0.001, 0, 0, 0, 0), "opencv_fisheye": (0.05, -0.01, 0, 0)
}  # fmt: skip


def said(camera, photo):
    """What a photo says of the ball as the camera sees it."""
    pixels, distance = picture_of(camera)
    directions = camera_space_directions(camera).numpy().reshape(*distance.shape, 3).astype(np.float64)
    return evidence(
        comparable(photo), comparable(pixels), pixels[..., 3], distance, directions, AWAY
    )  # fmt: skip


def step_of(found):
    """The motion told; of what pictures hardly tell, the least."""
    return np.linalg.solve(found.information + 1e-3 * np.diag(np.diag(found.information)), found.towards)


@pytest.mark.parametrize("lens", LENSES)
def test_pixels_shift_with_a_motion_as_the_points_that_they_show_are_projected(lens):
    """Against projections of the ball's points by the camera before and after each of the six motions."""
    camera = camera_at([AWAY, 0.4, 0.8], lens=lens, distortion=LENSES[lens])
    pixels, distance = picture_of(camera)
    # Away from the outline, where a pixel has one depth.
    inner = pixels[..., 3] > 0.999
    rows, columns = np.nonzero(inner)
    origins, directions = camera.rays(columns + 0.5, rows + 0.5)
    points = origins + distance[inner][:, None] * directions
    middle = np.linalg.norm(points - points.mean(0), axis=1) < 0.7 * RADIUS
    found = said(camera, pixels)
    shifts = np.full((*inner.shape, 2, 6), np.nan)
    shifts[_used(pixels)] = found.shifts
    before, _ = camera.project(points)
    for number in range(6):
        motion = 1e-4 * np.eye(6)[number]
        after, _ = moved(camera, motion, AWAY).project(points)
        expected = (before - after) / 1e-4
        np.testing.assert_allclose(
            shifts[inner][middle][:, :, number], expected[middle], atol=0.03 * np.abs(expected).max()
        )


def _used(pixels):
    """Where `evidence` looks, for a photo that is as rendered."""
    cover = ndimage.gaussian_filter(pixels[..., 3], DEPTH_BLUR)
    return (comparable(pixels)[..., 3] > LEAST_OPACITY) & (cover > LEAST_OPACITY)


@pytest.mark.parametrize("number", range(6))
def test_a_step_brings_a_camera_most_of_the_way_to_where_its_photo_was_taken(number):
    camera = camera_at([AWAY, -0.5, 0.3])
    # A roll and a shift along the view move pixels less.
    motion = (0.03 if number in (2, 5) else 0.006) * np.eye(6)[number]
    found = said(camera, picture_of(moved(camera, motion, AWAY))[0])
    step = step_of(found)
    assert found.pixels(motion) > 0.5
    assert found.pixels(step - motion) < 0.15 * found.pixels(motion)


def test_a_photo_as_rendered_moves_no_camera_and_one_without_the_object_says_nothing():
    camera = camera_at([0.5, AWAY, 0.3])
    pixels, distance = picture_of(camera)
    assert np.abs(said(camera, pixels).towards).max() == 0
    none = np.zeros_like(pixels)
    directions = camera_space_directions(camera).numpy().reshape(*distance.shape, 3)
    assert evidence(none, none, none[..., 3], 0 * distance, directions, AWAY) is None


def test_pixels_beyond_what_a_lens_sees_say_nothing():
    """There all rays are the last that it has."""
    camera = camera_at([AWAY, 0.4, 0.8])
    pixels, distance = picture_of(camera)
    directions = camera_space_directions(camera).numpy().reshape(*distance.shape, 3).astype(np.float64)
    directions[:, 50:] = directions[:, 50:51]
    photo = comparable(picture_of(camera_at([AWAY, 0.42, 0.8]))[0])
    found = evidence(photo, comparable(pixels), pixels[..., 3], distance, directions, AWAY)
    assert np.isfinite(found.information).all() and np.isfinite(found.shifts).all()
    assert np.linalg.matrix_rank(found.information) == 6


def test_a_lustre_that_is_not_rendered_moves_a_camera_little():
    """A highlight in the photo alone: such pixels count less the more they differ."""
    camera = camera_at([AWAY, 0.2, 0.5])
    pixels, _ = picture_of(camera)
    lit = pixels.copy()
    lit[40:46, 36:44, :3] = 0.9
    found = said(camera, lit)
    step = step_of(found)
    assert 0 < found.pixels(step) < 0.1
