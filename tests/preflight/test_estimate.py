"""Estimates of memory and time: by photos, points, cores and preset."""

import ctypes
import dataclasses
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from solver.capture.photos import Photo
from solver.fit.presets import settings_for
from solver.fit.ray_bank import RayBank
from solver.preflight.estimate import (
    BANK_BYTES,
    BASE_BYTES,
    DIRECTION_BYTES,
    FINDING_POINTS,
    FINDING_STANDING,
    WITHOUT_MASKS,
    estimate,
    memory_of_machine,
    photo_bytes,
)
from tests.preflight.captures import around, capture_at


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
    assert fewer.cores == cores
    draft = estimate(small, "draft", False, cores)
    assert draft.seconds <= fewer.seconds and draft.bytes <= fewer.bytes


def test_a_light_that_turns_takes_time_but_where_it_is_taken_to_stand_still():
    capture = capture_at(around(20))
    for preset, slower in (("draft", True), ("paper", False)):
        still, turned = (estimate(capture, preset, True, 2, turned=t).seconds for t in (False, True))
        assert (turned > 1.5 * still) == slower and turned >= still


def test_points_that_the_file_has_take_no_time():
    without = capture_at(around(20))
    having = dataclasses.replace(without, points=np.zeros((100, 3)))
    for masked, seconds in ((False, 20 * FINDING_POINTS / 2), (True, 0)):
        found, known = (estimate(c, "draft", masked, 2).seconds for c in (without, having))
        assert found - known == pytest.approx(seconds, abs=0.2)


def test_many_cores_take_no_less_than_what_one_has_to_do_alone():
    capture = capture_at(around(20))
    one, two, many = (estimate(capture, "draft", True, cores).seconds for cores in (1, 2, 1000))
    assert 0.5 * one < many < two < 0.9 * one


def test_what_stands_on_something_takes_the_time_of_masks_and_of_making_them():
    capture = capture_at(around(20))
    for preset in ("draft", "standard"):
        fog, standing, masked = (
            estimate(capture, preset, m, 1, standing=s).seconds
            for m, s in ((False, False), (False, True), (True, False))
        )
        assert masked < standing < fog
        assert standing == pytest.approx(masked + 20 * FINDING_STANDING)
        assert estimate(capture, preset, True, 1, standing=True).seconds == masked


def test_a_fog_on_a_coarser_grid_takes_less_time():
    capture, settings = capture_at(around(20)), settings_for("standard")
    assert settings.field.finest_without_masks < settings.field.sizes[-1]
    fog, masked = (estimate(capture, "standard", m, 1).seconds for m in (False, True))
    assert masked < fog < WITHOUT_MASKS * masked


def test_on_a_card_the_estimate_is_the_cards_and_says_so():
    capture = capture_at(around(60))
    for preset in ("draft", "standard", "paper"):
        slow, fast = (estimate(capture, preset, True, 2, card=card) for card in (None, "NVIDIA RTX 4000"))
        assert fast.seconds < slow.seconds / 3 and fast.bytes == slow.bytes
        assert "NVIDIA RTX 4000" in fast.line() and "processor" in slow.line()
    still, turned = (
        estimate(capture, "draft", True, 2, turned=t, card="a card").seconds for t in (False, True)
    )
    assert turned > still


@pytest.mark.parametrize(("answer", "memory"), [(1, 16 << 30), (0, None)])
def test_windows_is_asked_for_its_memory_in_its_own_words(monkeypatch, answer, memory):
    def tell(status):
        status = status._obj
        assert status.length == 64 == ctypes.sizeof(status), "Windows looks at it"
        ctypes.c_uint64.from_buffer(status, 8).value = 16 << 30
        return answer

    kernel32 = SimpleNamespace(GlobalMemoryStatusEx=tell)
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setattr(ctypes, "windll", SimpleNamespace(kernel32=kernel32), raising=False)
    assert memory_of_machine() == memory
