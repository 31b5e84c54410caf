"""Outlines of masks that do not fit each other, and what of them counts."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy import ndimage

from solver.fit.doubtful_outlines import AGAIN, NEVER, DoubtfulOutlines, doubtful_width, without_outlines
from solver.fit.mask_outlines import masks_of
from solver.fit.presets import settings_for
from solver.fit.ray_bank import RayBank
from solver.fit.start import new_trainer
from solver.fit.visual_hull import carve
from solver.render.image import ray_opacity
from tests.fit.painted_ball import painted_ball
from tests.fit.test_fit import resumed

SMALL = {
    "field.sizes": "80", "field.size_starts": "0", "light.heights": "16",
    "field.hull_cells": "48", "field.occupancy_cells": "32", "render.secondary_rays": "4",
    "field.turn_box": "no",
}  # fmt: skip
STEPS = 100


def with_masks(photos, pixels_of):
    """Photos of which each one's mask is grown by so many pixels, or shrunk; their colours stay, but for
    what was outside, which is dark."""
    made = []
    for index, photo in enumerate(photos):
        by = pixels_of(index)
        change = ndimage.grey_dilation if by > 0 else ndimage.grey_erosion
        alpha = photo.pixels[..., 3]
        if by:
            alpha = change(alpha, size=2 * abs(by) + 1)
        straight = photo.pixels[..., :3] / np.maximum(photo.pixels[..., 3:], 1e-4)
        made.append(replace(photo, pixels=np.dstack([straight * alpha[..., None], alpha])))
    return made


def too_narrow_or_too_wide(index):
    return (-1, 1, 0)[index % 3]


def trainer_of(pixels_of, **settings):
    capture, photos = painted_ball(18)
    masked = with_masks(photos, pixels_of)
    chosen = settings_for("draft", SMALL | settings)
    trainer = new_trainer(capture, masked, chosen, 0, None, "cpu", lambda done: None)
    return trainer, capture, photos, masked


def fitted(pixels_of, **settings):
    """As `trainer_of`, after some steps up to 0.3 of a fit."""
    found = trainer_of(pixels_of, **settings)
    for step in range(STEPS):
        found[0].advance(0.3 * step / STEPS)
    return found


@pytest.fixture(scope="module")
def doubted():
    return fitted(too_narrow_or_too_wide)


def width_of(pixels_of, views=18):
    capture, photos = painted_ball(views)
    return doubtful_width(capture, with_masks(photos, pixels_of), capture.region)


def test_masks_that_fit_each_other_all_count():
    assert width_of(lambda index: 0) == 0
    trainer, capture, *_ = trainer_of(lambda index: 0)
    assert trainer.outlines.width == 0 and trainer.outlines.next_look == NEVER
    assert torch.equal(trainer.bank.likely, trainer.bank._all_likely)
    assert trainer.outlines.told([camera.name for camera in capture.cameras]) is None


def test_the_less_masks_fit_each_other_the_wider_is_what_is_left_out():
    assert 1 <= width_of(too_narrow_or_too_wide) < width_of(lambda index: 3 * too_narrow_or_too_wide(index))


def test_masks_that_are_all_too_wide_fit_each_other():
    """Nothing tells of it, so they are believed."""
    assert width_of(lambda index: 1) == 0


def test_a_hull_without_what_is_in_doubt_holds_all_of_the_object():
    capture, photos = painted_ball(18)
    masked = with_masks(photos, too_narrow_or_too_wide)
    hulls = [
        carve(list(capture.cameras), masks_of(some), capture.region, 80)
        for some in (photos, masked, without_outlines(masked, 1))
    ]
    assert (hulls[0] & ~hulls[1]).sum() > 0.05 * hulls[0].sum()
    assert not (hulls[0] & ~hulls[2]).any()


def test_what_is_left_out_is_mostly_what_is_wrong(doubted):
    trainer, _, photos, masked = doubted
    true, given = (np.concatenate([p.pixels[..., 3].ravel() for p in some]) for some in (photos, masked))
    wrong = np.abs(true - given) > 0.5
    left_out = np.zeros(len(wrong), bool)
    left_out[trainer.outlines.left_out.numpy()] = True
    assert (wrong & left_out).sum() > 0.7 * left_out.sum()
    assert (wrong & left_out).sum() > 0.7 * wrong.sum()


def test_the_shape_is_nearer_to_the_truth(doubted):
    trainer, _, photos, _ = doubted

    def error(trainer):
        pixels = torch.arange(len(trainer.bank))
        batch = trainer.bank.batch(pixels)
        settings = trainer.loss.render_settings(0.3)
        opacity = ray_opacity(trainer.scene, settings, batch.origins, batch.directions[:, 0]).numpy()
        true = np.concatenate([photo.pixels[..., 3].ravel() for photo in photos])
        return float(np.abs(opacity - true).mean())

    believing = fitted(too_narrow_or_too_wide, **{"fit.doubt_outlines": "no"})[0]
    assert error(trainer) < 0.85 * error(believing)


def test_at_first_all_along_outlines_is_left_out():
    trainer, *_ = trainer_of(too_narrow_or_too_wide)
    for step in range(20):
        trainer.advance(0.12 * step / 20)
    outlines = trainer.outlines
    assert outlines.left_out.tolist() == outlines._in_doubt()[0].tolist()
    assert not torch.isin(trainer.bank.likely, outlines.left_out).any()
    assert outlines.next_look == AGAIN


def test_photos_are_named_whose_outlines_count_least_unless_they_are_most():
    trainer, capture, *_ = trainer_of(too_narrow_or_too_wide)
    outlines, bank, names = trainer.outlines, trainer.bank, [camera.name for camera in capture.cameras]
    everything = outlines.left_out
    told = outlines.told(names)
    assert "fit.doubt_outlines=no" in told and "most in" not in told
    of_two = everything[(everything >= bank.first_pixel[4]) & (everything < bank.first_pixel[6])]
    outlines.restore(outlines.state(), of_two)
    assert f"(most in {names[4]}, {names[5]})" in outlines.told(names)
    outlines.restore(outlines.state(), everything[:10])
    assert outlines.told(names) is None


def test_a_fit_goes_on_with_what_was_left_out(doubted, tmp_path):
    trainer, capture, _, masked = doubted
    other, _ = resumed(trainer, tmp_path, capture, masked)
    assert other.outlines.state() == trainer.outlines.state()
    assert torch.equal(other.outlines.left_out, trainer.outlines.left_out)
    assert torch.equal(other.bank.likely, trainer.bank.likely)


def test_what_counts_again_is_drawn_again():
    capture, photos = painted_ball(8)
    bank = RayBank(list(capture.cameras), photos)
    bank.BACKGROUND_SHARE = 0.0
    likely = torch.zeros(len(bank), dtype=torch.bool)
    likely[100:140] = True
    bank.restrict(likely)
    bank.leave_out(torch.arange(90, 120))
    assert set(bank.draw(2000, torch.Generator().manual_seed(0)).tolist()) == set(range(120, 140))
    bank.leave_out(torch.tensor([139]))
    assert set(bank.draw(2000, torch.Generator().manual_seed(0)).tolist()) == set(range(100, 139))


def test_pixels_are_counted_photo_by_photo():
    capture, photos = painted_ball(8)
    bank = RayBank(list(capture.cameras), photos)
    first = bank.first_pixel
    pixels = torch.tensor([0, first[1] - 1, first[1], first[7], first[7] + 5])
    assert bank.counted_by_photo(pixels).tolist() == [2, 1, 0, 0, 0, 0, 0, 2]


def test_what_a_photo_says_nothing_of_is_not_looked_at():
    capture, photos = painted_ball(8)
    told = np.ones(photos[0].pixels.shape[:2], bool)
    told[:, :48] = False
    bank = RayBank(list(capture.cameras), [replace(photos[0], told=told), *photos[1:]])
    bank.restrict(torch.ones(len(bank), dtype=torch.bool))
    outlines = DoubtfulOutlines(bank)
    outlines.begin(2)
    first = outlines.left_out[outlines.left_out < bank.first_pixel[1]]
    assert len(first) > 0 and told.ravel()[first.numpy()].all()


def test_alpha_that_a_job_has_made_itself_is_not_doubted():
    capture, photos = painted_ball(18)
    masked = with_masks(photos, too_narrow_or_too_wide)
    before_white = [replace(photo, backdrop="white") for photo in masked]
    assert doubtful_width(capture, masked, capture.region) > 0
    assert doubtful_width(capture, before_white, capture.region) == 0


def test_nothing_is_doubted_if_a_person_or_the_papers_preset_says_so():
    trainer, *_ = trainer_of(too_narrow_or_too_wide, **{"fit.doubt_outlines": "no"})
    assert trainer.outlines.width == 0
    assert settings_for("paper").fit.doubt_outlines is False
