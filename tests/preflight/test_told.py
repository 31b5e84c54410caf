"""A check looks at nothing that photos say nothing of."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from solver.capture.errors import CaptureError
from solver.preflight import photos as checks
from solver.preflight.check import check
from solver.preflight.looks import look_at, look_at_photos
from solver.preflight.reduced_photos import LONGEST, ReducedPhotos
from tests.preflight.captures import only, warnings, write


def left_half_black(colour, mask):
    dark = colour.copy()
    dark[:, : dark.shape[1] // 2] = 0
    return dark, mask


def ignoring(capture, path, numbers):
    """The capture with the left half of some photos to be ignored."""
    height, width = capture.cameras[0].height, capture.cameras[0].width
    picture = np.zeros((height, width), np.uint8)
    picture[:, : width // 2] = 255
    Image.fromarray(picture).save(path)
    cameras = [
        replace(camera, ignored_path=path) if i in numbers else camera
        for i, camera in enumerate(capture.cameras)
    ]
    return replace(capture, cameras=tuple(cameras))


@pytest.mark.parametrize("masked", [True, False])
def test_what_is_dark_and_ignored_is_not_underexposed(masked, pictures, tmp_path):
    (tmp_path / "photos").mkdir()
    capture = write(tmp_path / "photos", pictures, only(at3=left_half_black), masked)
    apart = checks.exposure(look_at_photos(capture))
    assert [finding.photo for finding in apart] == ["IMG_003"] and "darker" in apart[0].text
    capture = ignoring(capture, tmp_path / "ignore.png", {3})
    assert warnings(check(capture).findings) == []


def test_an_ignored_picture_that_cannot_be_used_ends_a_check_by_its_name(pictures, tmp_path):
    (tmp_path / "photos").mkdir()
    capture = ignoring(write(tmp_path / "photos", pictures), tmp_path / "ignore.png", {3})
    Image.new("L", (capture.cameras[0].width, capture.cameras[0].height), 255).save(tmp_path / "ignore.png")
    with pytest.raises(CaptureError, match="ignore.png, ignored_path: all of the photo 'IMG_003'"):
        check(capture)
    (tmp_path / "ignore.png").unlink()
    with pytest.raises(CaptureError, match="ignore.png, ignored_path: the mask does not exist"):
        check(capture)


RADIUS = 0.45
"""of the circle that fisheyes' images fill here, over the pictures' height"""


def beyond_circle(shape):
    """[H, W] bool: what lies beyond the circle in a picture's middle."""
    height, width = shape
    row, column = np.mgrid[:height, :width] + 0.5
    return np.hypot(row - height / 2, column - width / 2) > RADIUS * height


def in_a_circle(index, colour, mask):
    return np.where(beyond_circle(colour.shape[:2])[..., None], 0, colour).astype(np.uint8), mask


def of_fisheyes(capture):
    """The capture as if it had been taken by a fisheye of 180°, for all that a look at its photos tells."""
    lens = {"lens": "opencv_fisheye", "distortion": (0.0,) * 4}
    return replace(capture, cameras=tuple(replace(c, **lens) for c in capture.cameras))


def test_black_around_a_fisheyes_image_counts_for_nothing(pictures, tmp_path):
    captures = []
    for name, edit in (("whole", None), ("circle", in_a_circle)):
        (tmp_path / name).mkdir()
        capture = write(tmp_path / name, pictures, edit, masked=False)
        captures.append(replace(capture, cameras=capture.cameras[:8]))
    whole, circle = captures
    looks, photos = look_at_photos(of_fisheyes(circle)), ReducedPhotos()
    photos.find_circles(of_fisheyes(circle).cameras, lambda number, count: None)
    for look, camera in zip(looks, of_fisheyes(whole).cameras, strict=True):
        assert look.coverage is None and look.backdrop is None
        # As if the rest of a whole photo were to be ignored.
        other = look_at(replace(camera, told=photos.told(look.camera)), whole.region)
        assert (look.exposure, look.sharpness) == (other.exposure, other.sharpness)
        np.testing.assert_array_equal(look.thumbnail, other.thumbnail)
        assert look.thumbnail.max(-1).min() > 20, "nothing black"
    assert warnings(checks.blur(looks) + checks.exposure(looks) + checks.masks(looks)) == []
    # With a perspective lens it is what is behind something round.
    assert all(look.coverage is not None for look in look_at_photos(circle))


def test_circles_are_told_to_all_checks_and_found_in_photos_that_are_decoded_once(
    pictures, tmp_path, monkeypatch
):
    capture = of_fisheyes(write(tmp_path, pictures, in_a_circle, masked=False))
    capture = replace(capture, cameras=capture.cameras[:8])
    photos, numbers = ReducedPhotos(), []
    look_at_photos(capture, lambda number, count: numbers.append((number, count)), photos)
    assert numbers == sorted(numbers) and numbers[-1] == (8, 8) and numbers[0] == (0, 8)
    monkeypatch.setattr("solver.preflight.reduced_photos.load_reduced", None)
    for camera in capture.cameras:
        told = photos.told(camera)
        beyond = beyond_circle(photos(camera)[0].shape[:2])
        assert max(told.shape) <= LONGEST and not told[beyond].any() and told.mean() > 0.4


def test_where_alpha_says_what_is_the_object_nothing_is_a_fisheyes_circle(pictures, tmp_path):
    capture, photos = of_fisheyes(write(tmp_path, pictures, in_a_circle)), ReducedPhotos()
    look_at_photos(capture, None, photos)
    assert photos.told(capture.cameras[0]) is None
