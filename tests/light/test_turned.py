"""A light whose axes are turned: what is seen where, and how much of it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from solver.capture.frames import direction_from_equirect
from solver.light.environment import texel_solid_angles
from solver.light.turned import turned

HEIGHT = 64
ROTATIONS = {
    "any": Rotation.random(random_state=3).as_matrix(),
    "leaning": Rotation.from_euler("x", 0.4, degrees=True).as_matrix(),
    "on its side": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "on its head": np.diag([1.0, -1, -1]),
}
rotations = pytest.mark.parametrize("rotation", ROTATIONS.values(), ids=ROTATIONS)


def directions():
    row, column = np.mgrid[0:HEIGHT, 0 : 2 * HEIGHT] + 0.5
    return direction_from_equirect(np.stack([column / (2 * HEIGHT), row / HEIGHT], axis=-1))


def power(light):
    """Of each texel [H, W, 3]."""
    return light.astype(np.float64) * texel_solid_angles(HEIGHT).numpy()[:, None, None]


@rotations
def test_what_was_seen_along_a_direction_is_seen_along_the_turned_one(rotation):
    def sky(d):
        return np.stack([2 + d[..., 0], 2 + d[..., 1], 2 + d[..., 0] * d[..., 2]], axis=-1)

    expected = sky(directions() @ rotation)  # rows of Rᵀ d
    np.testing.assert_allclose(turned(sky(directions()), rotation), expected, atol=0.06)


@rotations
@pytest.mark.parametrize("row", [0, 1, 20, HEIGHT // 2, HEIGHT - 1])
def test_a_sun_keeps_its_power_and_goes_where_the_turn_takes_it(rotation, row):
    light = np.zeros((HEIGHT, 2 * HEIGHT, 3))
    light[row, 7] = 1e5, 8e4, 5e4
    arrived = power(turned(light, rotation))
    np.testing.assert_allclose(arrived.sum((0, 1)), power(light).sum((0, 1)), rtol=1e-6)
    middle = (arrived[..., :1] * directions()).sum((0, 1))
    texel = np.pi / HEIGHT
    away = middle / np.linalg.norm(middle) - rotation @ directions()[row, 7]
    assert np.linalg.norm(away) < texel
    shown = directions()[arrived[..., 0] > 0] @ (rotation @ directions()[row, 7])
    assert np.arccos(shown.min()) < 3.5 * texel


@rotations
def test_even_light_stays_even(rotation):
    light = turned(np.ones((HEIGHT, 2 * HEIGHT, 3)), rotation)
    assert np.abs(light - 1).max() < 0.02 and light.std() < 5e-3
