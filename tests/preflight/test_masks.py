"""Findings about masks, plain backdrops that stand in for them, and the box that they show."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from solver.preflight import photos as checks
from solver.preflight.bounds import object_box
from solver.preflight.check import check
from solver.preflight.looks import look_at_photos
from tests.cameras.box_scene import HALF
from tests.preflight.captures import only, warnings, write


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
    assert "no mask for 1 of 24 photos (IMG_012)" in general
    assert "cuts off the object in 1 of 24 photos (IMG_008)" in general
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
    assert any(f"behind the object is {name};" in finding.text for finding in report.findings)
    truth = np.array([-HALF, HALF]) + [0, 0, HALF[2]]
    assert (report.box[0] < truth[0]).all() and (report.box[1] > truth[1]).all()
    assert warnings(report.findings) == []


def test_a_backdrop_that_swallows_part_of_the_object_is_none(pictures, tmp_path, uncompared):
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


def test_without_masks_a_check_tells_of_what_the_object_may_stand_on(pictures, tmp_path, uncompared):
    capture = write(tmp_path, pictures, masked=False)
    low, high = capture.region
    plane = np.random.default_rng(0).uniform(low, high, (300, 3))
    plane[:, 2] = low[2] + 0.3 * (high[2] - low[2])
    level = replace(capture, points=plane, up=np.array([0.0, 0.0, 1.0]))

    def told(capture, **how):
        return [f.text for f in check(capture, **how).findings if "no photo has a mask" in f.text]

    assert "stands on the table" in told(level)[0]
    assert "stands on" not in told(level, preset="paper")[0]
    assert "stands on" not in told(replace(level, up=np.array([1.0, 0.0, 0.0])))[0]
    above = np.stack([[low[0], low[1], high[2] - 0.1], high])
    assert "stands on" not in told(level, region=above)[0]
