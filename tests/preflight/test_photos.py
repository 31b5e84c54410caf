"""Findings about photos: blur, exposure, duplicates, size; none where nothing is wrong."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from solver.capture.formats.transforms import write_transforms
from solver.capture.read import read_capture
from solver.capture.reduced import load_reduced
from solver.preflight import photos as checks
from solver.preflight import reduced_photos
from solver.preflight.check import check
from solver.preflight.looks import look_at_photos
from tests.preflight.captures import ROOT, blurred, only, warnings, write


def test_good_captures_have_no_warnings_with_and_without_masks(pictures, tmp_path):
    for masked in (True, False):
        folder = tmp_path / str(masked)
        folder.mkdir()
        report = check(write(folder, pictures, masked=masked))
        assert warnings(report.findings) == []
    report = check(read_capture(ROOT / "samples" / "duck"))
    assert warnings(report.findings) == []


@pytest.mark.parametrize("kept", [1 << 28, 0])
def test_photos_are_decoded_once_as_far_as_memory_for_them_goes(kept, pictures, tmp_path, monkeypatch):
    decoded = []

    def load(path, *arguments):
        decoded.append(path)
        return load_reduced(path, *arguments)

    monkeypatch.setattr(reduced_photos, "load_reduced", load)
    monkeypatch.setattr(reduced_photos, "MOST_KEPT", kept)
    capture = write(tmp_path, pictures, masked=False)
    found = look_at_photos(capture)
    assert [look.name for look in found] == [camera.name for camera in capture.cameras]
    assert set(decoded) == {camera.image_path for camera in capture.cameras}
    assert (len(decoded) == len(capture.cameras)) == bool(kept)


@pytest.mark.parametrize("masked", [True, False])
def test_blurred_photos_are_named_and_only_they(masked, pictures, tmp_path, uncompared):
    capture = write(tmp_path, pictures, only(at5=blurred(2.0), at11=blurred(4.0)), masked)
    found = warnings(check(capture).findings)
    assert {f.photo for f in found} == {"IMG_005", "IMG_011"}
    assert all("blurred" in f.text for f in found)


def test_motion_blur_counts_as_blur(pictures, tmp_path):
    def shaken(colour, mask):
        moved = np.mean([np.roll(colour, step, axis=1) for step in range(9)], axis=0)
        return moved.astype(np.uint8), mask

    found = warnings(check(write(tmp_path, pictures, only(at7=shaken))).findings)
    assert [f.photo for f in found] == ["IMG_007"] and "blurred" in found[0].text


def test_a_plain_object_is_not_blurred(pictures, tmp_path):
    def plain(index, colour, mask):
        # From every fourth place the object is one colour before one other.
        return (
            colour if index % 4 else np.where(mask[..., None], [180] * 3, [60] * 3).astype(np.uint8)
        ), mask

    capture = write(tmp_path, pictures, plain, masked=False)
    assert checks.blur(look_at_photos(capture)) == []


def brighter(stops):
    def edit(colour, mask):
        linear = (colour / 255.0) ** 2.2 * 2.0**stops
        return np.round(np.clip(linear, 0, 1) ** (1 / 2.2) * 255).astype(np.uint8), mask

    return edit


def test_overexposed_and_dark_photos_are_named(pictures, tmp_path):
    capture = write(tmp_path, pictures, only(at3=brighter(3.5), at9=brighter(-1.5), at15=brighter(0.3)))
    found = warnings(check(capture).findings)
    assert {f.photo for f in found} == {"IMG_003", "IMG_009"}
    bright = " ".join(f.text for f in found if f.photo == "IMG_003")
    assert "over-exposed" in bright and "brighter" in bright
    dark = [f.text for f in found if f.photo == "IMG_009"]
    assert len(dark) == 1 and re.search(r"1\.[3-7] stops darker", dark[0]) and "exposure" in dark[0]


def test_a_photo_that_shows_little_of_the_object_is_as_sharp_and_bright_as_that(pictures, tmp_path):
    def little(colour, mask):
        middle = int(mask.nonzero()[1].mean())
        mask = mask & (abs(np.arange(mask.shape[1]) - middle) < 3)
        return np.where(mask[..., None], colour, 0).astype(np.uint8), mask

    looks = look_at_photos(write(tmp_path, pictures, only(at7=little)))
    assert checks.exposure(looks) == [] and checks.blur(looks) == []


def test_brightness_is_compared_among_photos_that_look_the_same_way(pictures, tmp_path):
    looks = look_at_photos(write(tmp_path, pictures, only(at12=brighter(-2.5))))
    assert [finding.photo for finding in checks.exposure(looks)] == ["IMG_012"]
    # From 60° further around, the light may be on the object's other side.
    assert looks[12] in looks[::4] and checks.exposure(looks[::4]) == []


def test_a_white_backdrop_is_not_overexposure_but_a_burnt_out_object_is(pictures, tmp_path):
    def on_white(index, colour, mask):
        return np.where(mask[..., None], colour, 255).astype(np.uint8), mask

    (tmp_path / "white").mkdir()
    capture = write(tmp_path / "white", pictures, on_white, masked=False)
    assert checks.exposure(look_at_photos(capture)) == []
    (tmp_path / "burnt").mkdir()
    capture = write(tmp_path / "burnt", pictures, lambda i, c, m: brighter(3.5)(c, m))
    found = checks.exposure(look_at_photos(capture))
    assert len(found) == 1 and found[0].photo is None and "most photos" in found[0].text


def test_a_photo_that_is_there_twice_is_named_and_a_wrong_pose_is_told_apart(pictures, tmp_path):
    cameras, shots = pictures
    twice = [*cameras, replace(cameras[4], name="IMG_again")], [*shots, shots[4]]
    (tmp_path / "twice").mkdir()
    found = warnings(check(write(tmp_path / "twice", twice)).findings)
    assert [f.photo for f in found] == ["IMG_again"]
    assert "nearly the same as IMG_004" in found[0].text
    wrong = [*cameras, replace(cameras[10], name="IMG_again")], [*shots, shots[4]]
    (tmp_path / "wrong").mkdir()
    found = checks.duplicates(look_at_photos(write(tmp_path / "wrong", wrong)))
    assert len(found) == 1 and "one of the cameras is wrong" in found[0].text


def test_small_objects_are_warned_about_as_large_as_they_are_in_the_fit(pictures, tmp_path):
    capture = write(tmp_path, pictures)
    looks = look_at_photos(capture)
    (whole,) = checks.size(looks, capture, 0)
    (same,) = checks.size(looks, capture, 10**6)
    assert whole == same and whole.level == "note" and "scaled" not in whole.text
    far = [replace(look, across=160.0) for look in looks]
    assert warnings(checks.size(far, capture, 0)) == []
    camera = capture.cameras[0]
    (small,) = checks.size(far, capture, camera.width * camera.height // 4)
    assert small.level == "warning" and "80 pixels" in small.text and "50%" in small.text
    # Without masks the region stands for the object.
    bare = [replace(look, across=None) for look in looks]
    assert 100 < checks.pixels_across(bare, capture) <= capture.cameras[0].width


def lying_on_their_side(folder, pictures):
    """A capture of photos that EXIF asks to be turned, by cameras that did not heed it, with mask files."""
    cameras, shots = pictures
    exif = Image.Exif()
    exif[0x0112] = 6
    (folder / "masks").mkdir()
    named = []
    for camera, (colour, mask) in zip(cameras, shots, strict=True):
        Image.fromarray(colour).save(folder / f"{camera.name}.jpg", quality=95, exif=exif)
        shown = Image.fromarray(np.where(mask, 255, 0).astype(np.uint8))
        shown.save(folder / "masks" / f"{camera.name}.png")
        named.append(replace(camera, image_path=Path(f"{camera.name}.jpg")))
    write_transforms(folder / "transforms_train.json", named)
    return read_capture(folder)


def test_one_photo_that_is_scaled_down_makes_the_object_no_smaller_in_the_others(pictures, tmp_path):
    capture = write(tmp_path, pictures)
    looks = look_at_photos(capture)
    first, *others = capture.cameras
    mixed = replace(capture, cameras=(first.resized(20 * first.width, 20 * first.height), *others))
    most = first.width * first.height
    assert checks.size(looks, mixed, most) == checks.size(looks, capture, most)


def test_photos_that_ask_to_be_turned_are_looked_at_as_their_cameras_saw_them(pictures, tmp_path):
    """As COLMAP leaves them: the tag is there, and the camera is that of the pixels as they lie."""
    (tmp_path / "plain").mkdir()
    plain = check(write(tmp_path / "plain", pictures))
    (tmp_path / "turned").mkdir()
    capture = lying_on_their_side(tmp_path / "turned", pictures)
    report = check(capture)
    assert warnings(report.findings) == []
    np.testing.assert_allclose(report.box, plain.box, atol=0.05)
    look = look_at_photos(capture)[3]
    np.testing.assert_array_equal(look.mask, pictures[1][3][1])


def test_cut_outs_on_black_are_told_to_be_no_masks_and_many_empty_ones_are_one_finding(
    pictures, tmp_path, uncompared
):
    cameras, shots = pictures
    for kind in ("cut out", "empty"):
        (tmp_path / kind / "masks").mkdir(parents=True)
        capture = write(tmp_path / kind, pictures, masked=False)
        for camera, (colour, mask) in zip(cameras, shots, strict=True):
            shown = np.where(mask[..., None] & (kind == "cut out"), colour // 2, 0)
            Image.fromarray(shown.astype(np.uint8)).save(tmp_path / kind / "masks" / f"{camera.name}.png")
        said = [f.text for f in warnings(check(read_capture(tmp_path / kind)).findings)]
        if kind == "empty":
            assert f"{len(cameras)} masks are empty" in " ".join(said)
        else:
            assert any("as if it were transparent" in text for text in said)
        assert len(capture.cameras) == len(cameras)


def test_many_photos_with_one_problem_are_one_finding():
    looks = look_at_photos(read_capture(ROOT / "samples" / "duck"))[:20]
    clipped = [replace(look, clipped=0.5 if i < 8 else 0.0) for i, look in enumerate(looks)]
    found = [f for f in checks.exposure(clipped) if "over-exposed" in f.text]
    assert len(found) == 1 and found[0].photo is None
    assert "8 photos" in found[0].text and "50%" in found[0].text and looks[0].name in found[0].text
    few = [replace(look, clipped=0.5 if i < 2 else 0.0) for i, look in enumerate(looks)]
    named = [f.photo for f in checks.exposure(few) if "over-exposed" in f.text]
    assert named == [looks[0].name, looks[1].name]
