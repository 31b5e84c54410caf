"""Photos that are fitted at a smaller size."""

from pathlib import Path

import numpy as np
import pytest

from solver.capture.photos import Photo, at_sizes_of, load_photos, resized
from solver.capture.pinhole import size_meant
from solver.capture.read import read_capture
from solver.fit.presets import settings_for
from tests.capture.test_capture import camera

DUCK = Path(__file__).resolve().parents[2] / "samples" / "duck"


def test_large_photos_are_fitted_small_by_cameras_that_see_the_same():
    capture = read_capture(DUCK)
    whole = load_photos(capture)
    pixels = capture.cameras[0].width * capture.cameras[0].height
    small = load_photos(capture, most_pixels=pixels // 4)
    fitted = at_sizes_of(small, capture)
    assert small[0].pixels.shape == (
        capture.cameras[0].height // 2,
        capture.cameras[0].width // 2,
        4,
    )
    points = np.random.default_rng(0).uniform(-0.3, 0.3, (50, 3))
    for small_camera, before in zip(fitted.cameras[:5], capture.cameras, strict=False):
        np.testing.assert_allclose(
            2 * small_camera.project(points)[0], before.project(points)[0], atol=1e-6
        )
    for photo, before in zip(small[:5], whole, strict=False):
        blocks = before.pixels.reshape(photo.pixels.shape[0], 2, photo.pixels.shape[1], 2, 4)
        # Not quite a box: a filter that reaches a pixel further.
        assert np.abs(photo.pixels - blocks.mean((1, 3))).mean() < 0.01
        np.testing.assert_allclose(photo.pixels.mean((0, 1)), before.pixels.mean((0, 1)), atol=2e-3)
    assert at_sizes_of(whole, capture).cameras[0].lens_key == capture.cameras[0].lens_key
    assert settings_for("paper").photos.most_pixels == 0


def test_light_is_averaged_not_its_code_and_radiances_stay_above_white():
    pixels = np.zeros((40, 40, 4), np.float32)
    pixels[..., 3] = 1
    pixels[::2, :, :3] = 4.0
    small = resized(Photo(pixels, False, True), 10, 10).pixels
    np.testing.assert_allclose(small[2:-2, 2:-2, :3], 2.0, atol=0.15)
    assert small.dtype == np.float32 and small.shape == (10, 10, 4)


@pytest.mark.parametrize("most", [0, 64 * 48, 10**7])
def test_a_camera_is_made_no_larger_and_left_alone_where_it_is_small(most):
    whole = camera()
    assert whole.no_larger(most) is whole


def test_a_camera_keeps_its_shape_and_has_a_pixel_at_least():
    small = camera(width=4000, height=3000).no_larger(640_000)
    assert small.width * small.height == pytest.approx(640_000, rel=0.01)
    assert small.width / small.height == pytest.approx(4 / 3, rel=0.01)
    assert min(camera(width=10000, height=1).no_larger(100).width, 1) == 1


@pytest.mark.parametrize(
    "photo, lens",
    [
        ((1920, 1440), (4000, 3000)), ((1024, 768), (1920, 1440)), ((800, 600), (3000, 2250)),
        ((1600, 1067), (6000, 4000)), ((960, 720), (4032, 3024)), ((48, 32), (96, 64)),
    ],
)  # fmt: skip
def test_a_lens_whose_centre_is_the_very_middle_tells_its_photos_size(photo, lens):
    assert size_meant(photo, lens[0] / 2, lens[1] / 2) == pytest.approx(lens, abs=2)


@pytest.mark.parametrize("times", [0.25, 0.5, 2, 3])
def test_a_lens_with_a_measured_centre_is_for_a_size_that_is_a_whole_number_of_times_its_photos(
    times,
):
    """DTU's, in the photo as it was taken, 1600 × 1200."""
    photo = round(1600 / times), round(1200 / times)
    assert size_meant(photo, 823.2, 619.1) == pytest.approx((1600, 1200), abs=2)


def test_a_lens_that_was_measured_is_for_its_photo_where_its_centre_is_near_the_middle():
    assert size_meant((1600, 1200), 823.2, 619.1) == (1600, 1200)
    assert size_meant((1000, 750), 823.2, 619.1) == (1646, 1235)
