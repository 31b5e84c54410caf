"""The check before a reconstruction: every finding where it belongs, and nowhere else."""

import dataclasses
import json
import math
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image, ImageFilter

from solver.capture.capture import Capture, region_seen_by
from solver.capture.formats.transforms import write_transforms
from solver.capture.photos import Photo
from solver.capture.read import read_capture
from solver.fit.errors import SettingsError
from solver.fit.presets import settings_for
from solver.fit.ray_bank import RayBank
from solver.preflight import photos as checks
from solver.preflight.bounds import object_box
from solver.preflight.check import check
from solver.preflight.coverage import coverage, coverage_of, side_of
from solver.preflight.estimate import (
    BANK_BYTES,
    BASE_BYTES,
    DIRECTION_BYTES,
    FINDING_POINTS,
    cores_in_use,
    estimate,
    photo_bytes,
)  # fmt: skip
from solver.preflight.looks import look_at_photos
from tests.cameras.box_scene import HALF, BoxScene, box_camera, look_at

ROOT = Path(__file__).resolve().parents[2]


def around(count=24, heights=(0.9, 1.9), degrees=360.0, distance=2.6):
    """Poses on an arc around the box, at several heights in turn."""
    poses = []
    for i in range(count):
        angle = math.radians(degrees * i / count)
        position = np.array(
            [distance * math.cos(angle), distance * math.sin(angle), heights[i % len(heights)]]
        )
        poses.append(look_at(position, np.array([0.0, 0.0, 0.45])))
    return poses


@pytest.fixture(scope="module")
def pictures():
    """Photos of the box from all around with masks: cameras, colours, masks."""
    scene = BoxScene()
    cameras = [box_camera(pose, f"IMG_{i:03d}", None, 0.6) for i, pose in enumerate(around())]
    return cameras, [scene.photo(camera) for camera in cameras]


def write(folder, pictures, edit=None, masked=True):
    """A capture of the pictures; `edit` may change them: (index, colour, mask) -> (colour, mask)."""
    cameras, shots = pictures
    named = []
    for index, (camera, (colour, mask)) in enumerate(zip(cameras, shots, strict=True)):
        if edit is not None:
            colour, mask = edit(index, colour, mask)
        if masked and mask is not None:
            colour = np.concatenate([colour, np.where(mask, 255, 0)[..., None]], -1).astype(
                np.uint8
            )
        path = folder / f"{camera.name}.png"
        Image.fromarray(colour).save(path)
        named.append(replace(camera, image_path=Path(path.name)))
    write_transforms(folder / "transforms_train.json", named)
    return read_capture(folder)


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


def only(**edits):
    """An edit of single pictures: {"at3": function of colour, mask}."""
    chosen = {int(key[2:]): function for key, function in edits.items()}
    return lambda i, colour, mask: chosen[i](colour, mask) if i in chosen else (colour, mask)


def warnings(found):
    return [finding for finding in found if finding.level == "warning"]


def test_good_captures_have_no_warnings_with_and_without_masks(pictures, tmp_path):
    for masked in (True, False):
        folder = tmp_path / str(masked)
        folder.mkdir()
        report = check(write(folder, pictures, masked=masked))
        assert warnings(report.findings) == []
    report = check(read_capture(ROOT / "samples" / "duck"))
    assert warnings(report.findings) == []


def blurred(radius):
    def edit(colour, mask):
        return np.asarray(Image.fromarray(colour).filter(ImageFilter.GaussianBlur(radius))), mask

    return edit


@pytest.mark.parametrize("masked", [True, False])
def test_blurred_photos_are_named_and_only_they(masked, pictures, tmp_path):
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
    capture = write(
        tmp_path, pictures, only(at3=brighter(3.5), at9=brighter(-1.5), at15=brighter(0.3))
    )
    found = warnings(check(capture).findings)
    assert {f.photo for f in found} == {"IMG_003", "IMG_009"}
    bright = " ".join(f.text for f in found if f.photo == "IMG_003")
    assert "over-exposed" in bright and "brighter" in bright
    dark = [f.text for f in found if f.photo == "IMG_009"]
    assert len(dark) == 1 and re.search(r"1\.[3-7] stops darker", dark[0]) and "exposure" in dark[0]


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


def test_mixed_empty_full_and_cut_masks_are_told_apart(pictures, tmp_path):
    def shifted(colour, mask):
        moved = np.roll(mask, 110, axis=1)
        moved[:, :110] = False
        return colour, moved

    edit = only(
        at2=lambda c, m: (c, np.zeros_like(m)), at6=lambda c, m: (c, _all_but_a_corner(m)),
        at8=shifted, at12=lambda c, m: (c, None),
    )  # fmt: skip
    found = checks.masks(look_at_photos(write(tmp_path, pictures, edit)))
    told = {f.photo: f.text for f in warnings(found) if f.photo}
    assert set(told) == {"IMG_002", "IMG_006"}
    assert "empty" in told["IMG_002"] and "whole photo" in told["IMG_006"]
    general = " ".join(f.text for f in warnings(found) if f.photo is None)
    assert " photos have no mask (IMG_012)" in general
    assert "beyond the frame in 1 photos (IMG_008)" in general
    (tmp_path / "none").mkdir()
    found = checks.masks(look_at_photos(write(tmp_path / "none", pictures, masked=False)))
    assert [f.level for f in found] == ["note"] and "no photo has a mask" in found[0].text


@pytest.mark.parametrize(
    "name, level", [("plain white", 255), ("plain black", 0), ("a plain backdrop", None)]
)
def test_what_stands_before_a_plain_backdrop_has_masks(name, level, pictures, tmp_path):
    def before(index, colour, mask):
        if level is None:
            fading = np.linspace(60, 110, len(colour))[:, None, None] * (1.0, 0.95, 0.9)
            return np.where(mask[..., None], colour, fading).astype(np.uint8), None
        return np.where(mask[..., None], np.clip(colour, 20, 235), level).astype(np.uint8), None

    report = check(write(tmp_path, pictures, before, masked=False))
    assert any(f"before {name}" in finding.text for finding in report.findings)
    truth = np.array([-HALF, HALF]) + [0, 0, HALF[2]]
    assert (report.box[0] < truth[0]).all() and (report.box[1] > truth[1]).all()
    assert warnings(report.findings) == []


def test_a_backdrop_that_swallows_part_of_the_object_is_none(pictures, tmp_path):
    def before(index, colour, mask):
        colour = np.where(mask[..., None], np.clip(colour, 20, 235), 255).astype(np.uint8)
        colour[:, : colour.shape[1] // 2] = 255
        return colour, None

    report = check(write(tmp_path, pictures, before, masked=False))
    assert any("no photo has a mask" in finding.text for finding in report.findings)


def test_inverted_masks_are_told_as_such(pictures, tmp_path):
    capture = write(tmp_path, pictures, lambda i, colour, mask: (colour, ~mask))
    found = warnings(checks.masks(look_at_photos(capture)))
    assert len(found) == 1 and "invert them" in found[0].text


def _all_but_a_corner(mask):
    full = np.ones_like(mask)
    full[0, 0] = False
    return full


def test_mask_files_count_as_masks(pictures, tmp_path):
    cameras, shots = pictures
    (tmp_path / "masks").mkdir()
    for camera, (_, mask) in zip(cameras, shots, strict=True):
        Image.fromarray(mask).save(tmp_path / "masks" / f"{camera.name}.png")
    looks = look_at_photos(write(tmp_path, pictures, masked=False))
    for look, (_, mask) in zip(looks, shots, strict=True):
        assert look.coverage == pytest.approx(mask.mean(), abs=0.01)


def test_masks_show_where_the_object_is_even_in_a_region_that_is_far_too_large(pictures, tmp_path):
    capture = write(tmp_path, pictures)
    truth = np.array([-HALF, HALF]) + [0, 0, HALF[2]]
    for region in (capture.region, np.array([[-2.2] * 3, [2.0] * 3])):
        capture = replace(capture, region=region)
        box = object_box(capture, look_at_photos(capture), 0.08)
        # A hull is larger than what it holds where no camera looks from below or right above.
        assert (box[0] < truth[0]).all() and (box[1] > truth[1]).all()
        assert (box[0] > truth[0] - 0.45).all() and (box[1] < truth[1] + 0.45).all()


def test_masks_with_nothing_in_common_are_told_before_the_fit_fails(pictures, tmp_path):
    def aside(colour, mask):
        return colour, np.roll(np.where(mask, True, False), mask.shape[1] // 2, axis=1)

    report = check(write(tmp_path, pictures, only(at3=aside)))
    assert report.box is None and report.as_json()["box"] is None
    assert any("inside the masks of all photos" in f.text for f in warnings(report.findings))


def capture_at(poses, **changes):
    cameras = tuple(replace(box_camera(p), name=f"c{i}", **changes) for i, p in enumerate(poses))
    return Capture(Path("t.json"), cameras, np.array([[-0.5] * 3, [0.5] * 3]) + [0, 0, 0.45])


def texts(capture):
    return " ".join(finding.text for finding in warnings(coverage(capture)))


def test_cameras_on_one_side_leave_a_gap_behind():
    assert texts(capture_at(around(30))) == ""
    one_side = texts(capture_at(around(30, degrees=150)))
    assert "gap of 215°" in one_side and "from the left" in one_side
    centred = capture_at([*around(15, degrees=60), *around(15, degrees=-60)])
    assert "from behind (as seen in c0)" in texts(centred)
    few = texts(capture_at(around(12)))
    assert "only 12 photos" in few
    narrow = texts(capture_at(around(30, degrees=12, heights=(0.9,))))
    assert "walk around it" in narrow and "gap" not in narrow
    level = texts(capture_at(around(30, heights=(1.2,))))
    assert "one height" in level and "gap" not in level


def test_cameras_that_look_away_from_one_another_are_told_what_can_be_reconstructed():
    poses = around(24)
    for distance in (0.2, 2.6):
        outward = [
            pose @ np.diag([-1.0, 1, -1, 1]) for pose in around(24, (0.4, 0.5), distance=distance)
        ]
        capture = capture_at(outward)
        capture = replace(capture, region=region_seen_by(list(capture.cameras)))
        told = texts(capture)
        assert "24 of 24 cameras (c0 first) see nothing of the region" in told
        assert "one object that all photos show" in told
    # A few that look elsewhere are usual.
    assert "nothing of the region" not in texts(capture_at(poses[:20] + outward[20:]))


def test_sides_are_named_as_the_first_camera_sees_them():
    names = {0: "front", 90: "right", 180: "behind", 270: "left", -80: "left", 500: "behind"}
    for degrees, name in names.items():
        assert name in side_of(degrees)
    # The first camera stands at +X and looks along -X: its right hand is at +Y.
    camera = box_camera(around(4)[0])
    assert camera.camera_to_world[:3, 0] @ (0, 1, 0) > 0.99


def test_coverage_grows_with_cameras_and_knows_an_up_of_its_own():
    few, many = (coverage_of(capture_at(around(n, (0.45, 2.0, 3.5)))) for n in (8, 40))
    assert 0 < few.share < many.share < 1 and many.share < many.upper_share
    lying = capture_at(around(30, heights=(1.2,)))
    tipped = Capture(lying.source, lying.cameras, lying.region, up=np.array([1.0, 0, 0]))
    assert coverage_of(tipped).heights[1] > 60 > coverage_of(lying).heights[1]


def test_small_objects_are_warned_about_as_large_as_they_are_in_the_fit(pictures, tmp_path):
    capture = write(tmp_path, pictures)
    looks = look_at_photos(capture)
    (whole,) = checks.size(looks, capture, 0)
    (same,) = checks.size(looks, capture, 10**6)
    assert whole == same and whole.level == "note" and "made smaller" not in whole.text
    far = [replace(look, across=160.0) for look in looks]
    assert warnings(checks.size(far, capture, 0)) == []
    camera = capture.cameras[0]
    (small,) = checks.size(far, capture, camera.width * camera.height // 4)
    assert small.level == "warning" and "80 pixels" in small.text and "50%" in small.text
    # Without masks the region stands for the object.
    bare = [replace(look, across=None) for look in looks]
    assert 100 < checks.pixels_across(bare, capture) <= capture.cameras[0].width


def test_photo_memory_is_what_the_ray_bank_holds(pictures):
    capture = capture_at(around(5), width=48, height=36)
    pixels = np.ones((36, 48, 4), np.float32)
    bank = RayBank(list(capture.cameras), [Photo(pixels, False, False)] * 5)
    held = sum(t.numel() * t.element_size() for t in (bank.colour, bank.alpha))
    assert held == BANK_BYTES * 5 * 36 * 48
    assert bank.directions.numel() * bank.directions.element_size() == DIRECTION_BYTES * 36 * 48
    assert bank.directions.dtype == torch.float32
    expected = 5 * pixels.nbytes + 2 * (held + DIRECTION_BYTES * 36 * 48)
    assert photo_bytes(capture, masked=False) == expected
    assert photo_bytes(capture, masked=True) > expected


@given(st.integers(3, 40), st.integers(1, 64), st.sampled_from(["draft", "standard", "paper"]))
def test_estimates_grow_with_photos_and_shrink_with_cores(count, cores, preset):
    small, large = capture_at(around(count)), capture_at(around(count + 5))
    fewer, more = (estimate(c, preset, False, cores) for c in (small, large))
    assert more.bytes > fewer.bytes > BASE_BYTES[preset] and more.seconds >= fewer.seconds
    assert estimate(small, preset, False, cores + 1).seconds <= fewer.seconds
    assert 1 <= fewer.cores <= cores
    draft = estimate(small, "draft", False, cores)
    assert draft.seconds <= fewer.seconds and draft.bytes <= fewer.bytes


def test_a_light_that_turns_takes_time_but_where_it_is_taken_to_stand_still():
    capture = capture_at(around(20))
    for preset, slower in (("draft", True), ("paper", False)):
        still, turned = (
            estimate(capture, preset, True, 2, turned=t).seconds for t in (False, True)
        )
        assert (turned > 1.5 * still) == slower and turned >= still


def test_points_that_the_file_has_take_no_time():
    without = capture_at(around(20))
    having = dataclasses.replace(without, points=np.zeros((100, 3)))
    for masked, seconds in ((False, 20 * FINDING_POINTS / 2), (True, 0)):
        found, known = (estimate(c, "draft", masked, 2).seconds for c in (without, having))
        assert found - known == pytest.approx(seconds, abs=0.2)


def test_a_step_of_few_chunks_cannot_use_many_cores():
    assert cores_in_use(settings_for("draft"), 64) == 2
    assert cores_in_use(settings_for("standard"), 64) == 4
    assert cores_in_use(settings_for("paper"), 64) == 64


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


def solver(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "solver", "check", *map(str, arguments)], cwd=ROOT, text=True,
        capture_output=True, stdin=subprocess.DEVNULL, timeout=120,
    )  # fmt: skip


def test_the_command_prints_a_line_a_finding_or_one_json(pictures, tmp_path):
    write(tmp_path, pictures, only(at5=blurred(3.0)))
    before = sorted(tmp_path.iterdir())
    lines = solver(tmp_path)
    assert lines.returncode == 0 and lines.stderr == ""
    assert lines.stdout.splitlines()[0].startswith("warning: IMG_005: the photo is blurred")
    assert lines.stdout.splitlines()[-1].startswith("estimate: preset draft")
    content = json.loads(solver(tmp_path, "--json", "--preset", "standard").stdout)
    assert content["findings"][0]["photo"] == "IMG_005"
    assert set(content["findings"][0]) == {"level", "photo", "text"}
    assert content["estimate"]["preset"] == "standard" and content["estimate"]["seconds"] > 0
    assert "estimate" in content["estimate"]["note"]
    assert sorted(tmp_path.iterdir()) == before


def test_what_cannot_be_read_ends_with_code_2_and_one_sentence(pictures, tmp_path):
    write(tmp_path, pictures)
    (tmp_path / "IMG_003.png").write_bytes((tmp_path / "IMG_003.png").read_bytes()[:400])
    for arguments in ([tmp_path], [tmp_path / "nowhere"], [tmp_path, "--preset", "fast"]):
        result = solver(*arguments)
        assert result.returncode == 2 and len(result.stderr.strip().splitlines()) == 1
    with pytest.raises(SettingsError):
        check(capture_at(around(4)), "fast")


def test_many_photos_with_one_problem_are_one_finding():
    looks = look_at_photos(read_capture(ROOT / "samples" / "duck"))[:20]
    clipped = [replace(look, clipped=0.5 if i < 8 else 0.0) for i, look in enumerate(looks)]
    found = [f for f in checks.exposure(clipped) if "over-exposed" in f.text]
    assert len(found) == 1 and found[0].photo is None
    assert "8 photos" in found[0].text and "50%" in found[0].text and looks[0].name in found[0].text
    few = [replace(look, clipped=0.5 if i < 2 else 0.0) for i, look in enumerate(looks)]
    named = [f.photo for f in checks.exposure(few) if "over-exposed" in f.text]
    assert named == [looks[0].name, looks[1].name]
