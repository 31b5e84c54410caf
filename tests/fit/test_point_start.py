"""The start of fits without masks: denser where sparse points are."""

import dataclasses
import time

import numpy as np
import pytest
import torch

from solver.apart import ApartError
from solver.capture.capture import FEWEST_POINTS
from solver.capture.triangulate import Triangulated
from solver.field.room import contract
from solver.fit import point_start
from solver.fit.point_start import density_near, found_in_photos
from solver.fit.start import new_trainer, starts_from_points
from tests.fit.test_fit import SMALL, ball_capture
from tests.fit.test_fog import room_capture

DENSITY = 4.0


def started(points, density=DENSITY):
    capture, photos = room_capture()
    settings = dataclasses.replace(SMALL, field=dataclasses.replace(SMALL.field, points_density=density))
    capture = dataclasses.replace(capture, points=points)
    return new_trainer(capture, photos, settings, 0, None, "cpu", lambda done: None).scene


def some_points(scene, count, rng):
    """So many in the box, and as many up to two boxes away from it."""
    unit = rng.uniform(-1, 1, (2 * count, 3))
    inside, outside = 0.9 * unit[:count], unit[count:]
    outside *= rng.uniform(1.1, 3.0, (count, 1)) / np.abs(outside).max(1, keepdims=True)
    half, centre = scene.field.half_size, scene.field.centre.numpy()
    return half * inside + centre, half * outside + centre


def test_field_and_room_are_denser_at_points_and_thin_elsewhere():
    rng = np.random.default_rng(0)
    plain = started(None)
    inside, outside = some_points(plain, 6, rng)
    scene = started(np.concatenate([inside, outside]))
    field, room = scene.field, scene.room

    def in_box(places):
        return field.raw_density(field.to_box(torch.tensor(places, dtype=torch.float32)))

    def in_room(places):
        unit = room.to_unit(torch.tensor(places, dtype=torch.float32))
        cells = room.allowed.clone()
        room.allowed.fill_(True)
        found = room.extinction(contract(unit))
        room.allowed.copy_(cells)
        return found

    with torch.no_grad():
        elsewhere = some_points(plain, 400, rng)
        near = [
            np.linalg.norm(e[:, None] - p, axis=-1).min(1) > 0.6 * field.half_size
            for e, p in zip(elsewhere, (inside, outside), strict=True)
        ]
        assert in_box(inside).mean() > 0.5 * DENSITY
        assert in_box(elsewhere[0][near[0]]).abs().mean() < 0.1 * DENSITY
        thin = in_room(elsewhere[1][near[1]]).median()
        assert in_room(outside).median() > 5 * thin


def test_a_point_counts_once_however_many_lie_beside_it():
    one = density_near(torch.zeros(1, 3), 33)
    assert one.max() == one[16, 16, 16] == pytest.approx(1, abs=0.02)
    crowd = density_near(0.2 * torch.rand(5000, 3) - 0.1, 33)
    assert crowd.max() == 1
    assert density_near(torch.full((3, 3), 1.5), 33).max() == 0


def test_without_points_or_with_no_density_the_fog_is_even():
    for scene in (started(None), started(np.zeros((5, 3)), density=0.0)):
        with torch.no_grad():
            assert scene.field.raw_density_grid(24).abs().max() < 1


def test_points_are_looked_for_only_where_masks_and_the_file_say_nothing(monkeypatch):
    asked = []

    def found(cameras, photos, progress, tolerated):
        asked.append(len(cameras))
        return Triangulated(np.ones((7, 3)))

    monkeypatch.setattr(point_start, "triangulate", found)
    capture, photos = room_capture()
    assert len(found_in_photos(capture, photos, lambda done: None).points) == 7
    few = dataclasses.replace(capture, points=np.zeros((FEWEST_POINTS - 1, 3)))
    assert len(found_in_photos(few, photos, lambda done: None).points) == 7
    enough = dataclasses.replace(capture, points=np.zeros((FEWEST_POINTS, 3)))
    assert found_in_photos(enough, photos, lambda done: None) is None
    assert asked == [len(photos)] * 2
    assert starts_from_points(photos, SMALL)
    assert not starts_from_points(ball_capture()[1], SMALL)


def test_a_search_for_points_that_takes_too_long_is_given_up(monkeypatch):
    def endless(cameras, photos, progress, tolerated):
        for _ in range(1000):
            time.sleep(0.01)
            progress(0.1)

    monkeypatch.setattr(point_start, "triangulate", endless)
    told = []
    with pytest.raises(ApartError, match="no time"):
        found_in_photos(*room_capture(), told.append, seconds=0.05)
    assert 1 < len(told) < 500
