"""Captures of camera raw photos: checked, copied for Blender, prepared for a solve of their cameras."""

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from solver.cameras.prepare import look_at, write_prepared
from solver.capture.colour import linear_to_srgb
from solver.capture.errors import CaptureError
from solver.capture.formats.transforms import write_transforms
from solver.capture.read import read_capture
from solver.capture.reduced import load_reduced
from solver.preflight.check import check
from solver.preflight.white_balance import white_balance
from tests.capture.raw_photos import patches, write_dng
from tests.preflight.captures import around, capture_at
from tests.preflight.test_command import solver

SUNNY, CLOUDY = (0.5, 1.0, 0.7), (0.55, 1.0, 0.62)


def write_raw(folder, neutrals, orientation=1, turned=False):
    """Raw photos with the cameras of a walk around, by what each says of white."""
    cameras = []
    size = (64, 128) if turned else (128, 64)
    for number, camera in enumerate(capture_at(around(len(neutrals))).cameras):
        colours = np.random.default_rng(number).uniform(0.1, 0.8, (8, 3))
        name = f"IMG_{number}.dng"
        write_dng(folder / name, patches(colours), neutral=neutrals[number], orientation=orientation)
        camera = replace(camera, name=f"IMG_{number}", image_path=None, mask_path=None).resized(*size)
        cameras.append(replace(camera, image_path=folder / name))
    write_transforms(folder / "transforms_train.json", cameras)
    return read_capture(folder)


def test_a_white_balance_that_the_camera_changed_is_told_with_the_remedy(tmp_path):
    capture = write_raw(tmp_path, [SUNNY] * 5 + [CLOUDY])
    (found,) = white_balance(capture)
    assert found.level == "warning" and "differs by up to 13%" in found.text
    assert "fit.exposure=white_balance" in str(check(capture).findings)
    evened = check(capture, overrides={"fit.exposure": "white_balance"})
    assert "white balance" not in str(evened.findings)


def test_one_white_balance_and_none_are_nothing_to_tell(tmp_path, pictures):
    (tmp_path / "a").mkdir()
    assert white_balance(write_raw(tmp_path / "a", [SUNNY] * 20)) == []
    (tmp_path / "b").mkdir()
    assert white_balance(write_raw(tmp_path / "b", [None] * 3)) == []
    assert white_balance(capture_at(around(4))) == []


def test_a_capture_of_which_only_some_photos_are_raw_is_told(tmp_path):
    capture = write_raw(tmp_path, [SUNNY] * 6)
    for number in (1, 4):
        Image.new("RGB", (128, 64)).save(tmp_path / f"{number}.png")
    cameras = [
        replace(camera, image_path=tmp_path / f"{number}.png") if number in (1, 4) else camera
        for number, camera in enumerate(capture.cameras)
    ]
    (found,) = white_balance(replace(capture, cameras=tuple(cameras)))
    assert found.level == "warning" and found.text.startswith("4 of 6 photos are raw")
    unnamed = tuple(replace(camera, image_path=None) for camera in cameras[:2])
    assert white_balance(replace(capture, cameras=(*unnamed, *capture.cameras[2:]))) == []


def test_a_cut_raw_photo_ends_a_check_by_name(tmp_path):
    capture = write_raw(tmp_path, [SUNNY] * 4)
    photo = tmp_path / "IMG_2.dng"
    photo.write_bytes(photo.read_bytes()[:-100])
    with pytest.raises(CaptureError, match="IMG_2.dng: the raw photo is cut off; replace the photo"):
        check(capture)


@pytest.mark.parametrize("turned", [False, True])
def test_raw_photos_are_copied_as_their_cameras_saw_them(turned, tmp_path):
    write_raw(tmp_path, [SUNNY] * 3, orientation=6, turned=turned)
    result = solver(tmp_path, "--out", tmp_path / "out", "--events", command="pictures")
    assert result.returncode == 0, result.stderr
    events = [json.loads(line) for line in result.stdout.splitlines()]
    made = next(event for event in events if event["ev"] == "result")["pictures"]
    assert made == {
        str(tmp_path / f"IMG_{n}.dng"): str(tmp_path / "out" / f"IMG_{n}.jpg") for n in range(3)
    }
    seen = (64, 128) if turned else (128, 64)
    for photo, picture in made.items():
        colour, _ = load_reduced(tmp_path / photo, 800, seen)
        copied, _ = load_reduced(tmp_path / picture, 800)
        assert copied.shape == (*seen[::-1], 3)
        assert np.abs(copied.astype(float) - colour).mean() < 4


def test_features_are_sought_in_raw_photos_upright_and_in_srgb(tmp_path):
    (tmp_path / "photos").mkdir()
    write_raw(tmp_path / "photos", [SUNNY] * 3, orientation=8)
    (photo, *_) = look_at(tmp_path / "photos", ("IMG_0.dng",), None, 1600)
    assert (photo.width, photo.height, photo.focal) == (64, 128, None)
    write_prepared(photo, tmp_path, tmp_path)
    grey, _ = load_reduced(tmp_path / photo.file, 128)
    assert grey.shape == (128, 64, 3)
    colours = np.random.default_rng(0).uniform(0.1, 0.8, (8, 3)).reshape(2, 4, 3)
    expected = 255 * linear_to_srgb(np.rot90(colours)) @ (0.299, 0.587, 0.114)
    np.testing.assert_allclose(grey[16::32, 16::32, 0], expected, atol=2)
