"""A light that goes round with the cameras: it is the object that turns."""

import dataclasses
import math
from functools import partial

import numpy as np
import pytest
import torch

from solver.capture.turntable import Turntable
from solver.render.composition import Composition, Placement
from solver.render.image import render_view
from solver.render.probing import refresh_probes
from solver.render.scene import SharedTables, StepTables
from tests.render.scenes import ball
from tests.render.test_invariance import SETTINGS, camera, light_of, lumpy, sky

UP, MIDDLE, ALONG_X = np.array([0, 0, 1.0]), np.zeros(3), np.array([1.0, 0, 0])
MANY = dataclasses.replace(SETTINGS, secondary_rays=256)


@pytest.mark.parametrize("angle", [math.pi / 2, -0.7])
def test_a_turned_light_shows_what_a_turned_object_shows(angle):
    scene = lumpy()
    turn = Turntable(UP, MIDDLE, ALONG_X).rotation(angle)
    tables = StepTables.of(scene, torch.tensor(turn, dtype=torch.float32))
    lit = render_view(scene, tables, MANY, camera(turn=turn))
    back = Composition([scene], [Placement(turn=-angle)], scene.environment)
    still = render_view(back, StepTables.of(back), MANY, camera())
    unturned = render_view(scene, StepTables.of(scene), MANY, camera(turn=turn))

    def error(picture):
        return np.sqrt(((picture.radiance - still.radiance) ** 2).mean())

    np.testing.assert_allclose(lit.opacity, still.opacity, atol=1e-2)
    assert error(lit) < 0.01 < 0.05 < error(unturned)


def test_a_light_may_turn_about_any_axis():
    tilt = torch.tensor([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    here, there = (
        ball(environment=light_of(light), sharpness=2000.0, f0=0.4, roughness=0.4)
        for light in (sky, lambda d: sky(d @ tilt))
    )
    turned = render_view(here, StepTables.of(here, tilt), SETTINGS, camera())
    expected = render_view(there, StepTables.of(there), SETTINGS, camera())
    np.testing.assert_allclose(turned.radiance, expected.radiance, atol=5e-3)


def test_each_camera_sees_the_light_where_the_turntable_has_it():
    scene = lumpy()
    assert scene.turn_for(camera()) is None
    scene.turntable = Turntable(UP, MIDDLE, ALONG_X)
    aside = camera(position=(0.0, 3.0, 0.8))
    turn = scene.turn_for(aside)
    np.testing.assert_allclose(turn, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-6)
    for found, expected in zip(
        StepTables.seen_by(aside, scene).light, scene.environment.tables(turn=turn), strict=True
    ):
        assert torch.equal(found, expected)


def test_tables_under_several_turns_are_those_of_each():
    scene = lumpy()
    turns = [None, torch.tensor(Turntable(UP, MIDDLE, ALONG_X).rotation(1.0)).float()]
    shared = SharedTables.of(scene, turns)
    for index, turn in enumerate(turns):
        alone = StepTables.of(scene, turn)
        assert torch.equal(shared.under(index).light.table, alone.light.table)
        assert torch.equal(shared.under(index).light.irradiance, alone.light.irradiance)


def test_gradients_under_all_turns_reach_the_one_light():
    scene = lumpy()
    turns = [torch.tensor(Turntable(UP, MIDDLE, ALONG_X).rotation(a)).float() for a in (0.3, 2.0)]

    def total(light):
        return (light.table.sum() + light.irradiance.square().sum()).float()

    sum(total(StepTables.of(scene, turn).light) for turn in turns).backward()
    expected = scene.environment.log_radiance.grad.clone()
    scene.environment.log_radiance.grad = None
    shared = SharedTables.of(scene, turns)
    cut = shared.cut()
    for index in range(len(turns)):
        total(cut.under(index).light).backward()
    assert scene.environment.log_radiance.grad is None
    shared.carry(cut)
    torch.testing.assert_close(scene.environment.log_radiance.grad, expected)


def test_what_blocks_light_sends_the_mean_of_a_turn():
    """Probes' bounced light must not depend on which side the light is on at `zero`."""
    sent = []
    for side in torch.eye(3)[:2]:
        scene = ball(environment=light_of(partial(lit_from, side)))
        scene.turntable = Turntable(UP, MIDDLE, ALONG_X)
        refresh_probes(scene)
        sent.append(scene.probes.arriving.sent)
    assert sent[0].abs().max() > 0.01
    torch.testing.assert_close(sent[0], sent[1], atol=2e-3, rtol=2e-2)


def lit_from(side, directions):
    level = 2 * (directions @ side)[..., None].clamp(min=0) + 0.1
    return level.expand(*directions.shape[:-1], 3)
