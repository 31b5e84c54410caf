"""A check looks at nothing that photos say nothing of."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from solver.capture.errors import CaptureError
from solver.preflight import photos as checks
from solver.preflight.check import check
from solver.preflight.looks import look_at_photos
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
    Image.new("L", (capture.cameras[0].width, capture.cameras[0].height), 255).save(
        tmp_path / "ignore.png"
    )
    with pytest.raises(CaptureError, match="ignore.png, ignored_path: all of the photo 'IMG_003'"):
        check(capture)
    (tmp_path / "ignore.png").unlink()
    with pytest.raises(CaptureError, match="ignore.png, ignored_path: the mask does not exist"):
        check(capture)
