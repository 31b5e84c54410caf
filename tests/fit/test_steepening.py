"""Surfaces become steep over a fit (docs/decisions/0051)."""

import dataclasses

import pytest
import torch

from solver.fit.presets import DRAFT, PAPER, STANDARD
from solver.fit.schedule import steepness
from solver.fit.settings import FieldSettings
from solver.fit.start import new_trainer
from solver.fit.trainer import Trainer
from tests.fit.test_fit import SMALL, ball_capture, resumed, trained
from tests.fit.test_fog import room_capture


@pytest.fixture(autouse=True)
def at_every_step(monkeypatch):
    monkeypatch.setattr(Trainer, "OCCUPANCY_EVERY", 1)


def test_a_density_steepens_by_equal_factors_between_two_fractions_of_a_fit():
    field = FieldSettings(steepening=4.0, steepening_span=(0.1, 0.6))
    at = (0.0, 0.1, 0.35, 0.6, 1.0)
    assert [steepness(field, fraction) for fraction in at] == pytest.approx([1, 1, 2, 4, 4])


def test_papers_density_is_as_the_fit_makes_it():
    assert steepness(PAPER.field, 1.0) == 1
    assert min(steepness(preset.field, 1.0) for preset in (DRAFT, STANDARD)) > 2


def test_a_fit_ends_as_steep_as_asked_for_and_a_resumed_one_is_no_steeper(tmp_path):
    trainer, _, capture, photos = trained()
    first, last = SMALL.field.steepening_span
    for fraction in (0.0, first):
        trainer.advance(fraction)
    assert trainer.scene.field.steepness == 1
    trainer.advance((first + last) / 2)
    half = trainer.scene.field.steepness
    assert half == pytest.approx(SMALL.field.steepening**0.5)
    other, _ = resumed(trainer, tmp_path, capture, photos)
    assert other.scene.field.steepness == half
    for one in (trainer, other):
        one.advance(0.99)
        assert one.scene.field.steepness == pytest.approx(SMALL.field.steepening)
    torch.testing.assert_close(other.scene.field.density_shift, trainer.scene.field.density_shift)


def test_what_starts_as_a_fog_stays_as_soft_as_the_fit_makes_it():
    capture, photos = room_capture()
    trainer = new_trainer(capture, photos, SMALL, 0, None, "cpu", lambda fraction: None)
    shift = trainer.scene.field.density_shift
    trainer.advance(0.99)
    assert trainer.fog and trainer.scene.field.steepness == 1
    assert trainer.scene.field.density_shift == shift


def test_a_density_that_is_to_stay_as_it_is_does():
    capture, photos = ball_capture()
    plain = dataclasses.replace(SMALL, field=dataclasses.replace(SMALL.field, steepening=1.0))
    trainer = new_trainer(capture, photos, plain, 0, None, "cpu", lambda fraction: None)
    shift = trainer.scene.field.density_shift
    trainer.advance(0.99)
    assert not trainer.fog and trainer.scene.field.density_shift == shift
