"""How far outlines lie outside of the hull of all, which tells how far cameras are off."""

from dataclasses import replace

import numpy as np

from solver.fit.outline_gap import FARTHEST, outline_gap
from solver.fit.start import masks_of
from tests.fit.painted_ball import painted_ball


def gap_of(capture, photos):
    return outline_gap(list(capture.cameras), lambda: masks_of(photos), capture.region)


def test_outlines_fit_right_cameras_and_lie_the_farther_outside_the_more_cameras_are_off():
    gaps = [gap_of(*painted_ball(16, degrees)) for degrees in (0.0, 0.3, 1.0)]
    assert gaps[0] < 0.05
    assert 1.5 * gaps[0] < gaps[1] < 0.5 * gaps[2] < FARTHEST


def test_a_wrong_camera_shows_in_the_outlines_of_the_others_not_in_their_median():
    capture, photos = painted_ball(16)
    wrong, _ = painted_ball(16, 1.0)
    one = replace(capture, cameras=(wrong.cameras[0], *capture.cameras[1:]))
    assert gap_of(one, photos) < 0.2 * gap_of(wrong, photos)


def test_masks_without_anything_in_common_have_no_gap():
    capture, photos = painted_ball(8)
    # Each photo shows a corner of its own.
    apart = []
    for index, photo in enumerate(photos):
        pixels = np.zeros_like(photo.pixels)
        pixels[:8, :8] = 1
        apart.append(replace(photo, pixels=np.rot90(pixels, index).copy()))
    assert gap_of(capture, apart) is None


def test_masks_without_an_outline_have_no_gap():
    capture, photos = painted_ball(8)
    full = [replace(photo, pixels=np.ones_like(photo.pixels)) for photo in photos]
    assert gap_of(capture, full) is None


def test_where_a_photo_ends_is_no_outline():
    """A ball that is partly beyond the frame fits as well as a whole one."""
    capture, photos = painted_ball(16)
    width = 56
    cut = [replace(photo, pixels=photo.pixels[:, :width].copy()) for photo in photos]
    cameras = [replace(camera, width=width) for camera in capture.cameras]
    assert gap_of(replace(capture, cameras=tuple(cameras)), cut) < 0.05
