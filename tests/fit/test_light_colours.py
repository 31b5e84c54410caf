"""Colours of a light at the end of a fit."""

import dataclasses

import numpy as np
import pytest
import torch

from solver.fit.light_colours import SQUARES, coarsest_colours
from solver.light.environment import coarsely_coloured, texel_solid_angles
from tests.fit.test_fit import SMALL, ball_capture, new_trainer


def light(height=32, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(3, height, 2 * height, generator=generator) + 0.1


def test_coarse_colours_leave_all_brightness_where_it_is():
    radiance = light()
    coarse = coarsely_coloured(radiance, 4)
    torch.testing.assert_close(coarse.mean(0), radiance.mean(0))


def test_a_light_of_one_colour_stays_as_it_is():
    radiance = light().mean(0) * torch.tensor([0.2, 0.5, 0.9])[:, None, None]
    torch.testing.assert_close(coarsely_coloured(radiance, 8), radiance)


def test_the_colour_of_a_squares_centre_is_that_of_its_energy():
    """A lamp gives its colour to what is around it, not the other way round."""
    radiance = torch.full((3, 32, 64), 0.1)
    radiance[:, 13, 22] = torch.tensor([900.0, 90.0, 9.0])
    texels = 3  # odd, so that a square has a texel at its centre
    padded = radiance[:, :30, :60]
    coarse = coarsely_coloured(padded, texels)
    for row, column in ((13, 22), (16, 22), (4, 40)):
        square = padded[:, row - 1 : row + 2, column - 1 : column + 2]
        solid = texel_solid_angles(30)[row - 1 : row + 2, None]
        energy = (square * solid.float()).sum((1, 2))
        here = coarse[:, row, column]
        torch.testing.assert_close(here / here.mean(), energy / energy.mean())


def test_coarse_colours_send_as_much_of_each_channel():
    """Where the energy of a square is in its middle; blending between squares moves some of it."""
    radiance = light(64) * 1e-3
    radiance[:, 4::8, 4::8] = 10 * light(8, 1)
    solid = texel_solid_angles(64)[:, None]
    sent, before = (
        (solid.float() * map_).sum((1, 2)) for map_ in (coarsely_coloured(radiance, 8), radiance)
    )
    torch.testing.assert_close(sent, before, rtol=0.02, atol=0)


@pytest.mark.parametrize("finest", [2, 4, 8, 16, 32])
def test_colours_become_as_coarse_as_photos_allow(finest):
    radiance = light()
    known = {t: coarsely_coloured(radiance, t) for t in SQUARES}

    def error(candidate):
        texels = next((t for t, map_ in known.items() if torch.equal(map_, candidate)), 1)
        return 1.0 if texels == 1 else 1.0005 if texels < finest else 1.002

    found = coarsest_colours(radiance, error, 1e-3)
    allowed = [t for t in SQUARES if t < finest]
    torch.testing.assert_close(found, known[allowed[0]] if allowed else radiance, rtol=0, atol=0)
    assert coarsest_colours(radiance, error, 1e-4) is radiance


def test_maps_that_no_square_divides_stay_as_they_are():
    radiance = light(5)
    assert coarsest_colours(radiance, lambda candidate: 1.0, 1e-3) is radiance


def finished(tolerance, far=None, noise=0.5, steps=6):
    """The light before and after the end of a short fit, whose light has noise in its colours."""
    capture, photos = ball_capture()
    settings = dataclasses.replace(
        SMALL,
        light=dataclasses.replace(SMALL.light, colour_tolerance=tolerance, heights=(32,)),
        field=dataclasses.replace(SMALL.field, sizes=(24,), size_starts=(0.0,)),
    )
    trainer = new_trainer(capture, photos, settings, 0, None, "cpu", lambda fraction: None)
    for step in range(steps):
        trainer.advance(step / steps)
    environment = trainer.scene.environment
    with torch.no_grad():
        environment.log_radiance.add_(noise * torch.randn(environment.log_radiance.shape))
    before = environment.image()
    trainer.far = far
    trainer.finish()
    return before, environment.image()


def specks(image):
    """How much the colours of texels beside each other differ."""
    colour = image / image.mean(-1, keepdims=True)
    return np.abs(np.diff(colour, axis=1)).mean()


def test_at_the_end_of_a_fit_noise_goes_from_the_colours_of_the_light():
    """Photos of a white, rough ball tell nothing of fine colours."""
    torch.manual_seed(3)
    before, after = finished(0.01)
    assert specks(after) < 0.3 * specks(before)
    np.testing.assert_allclose(after.mean(-1), before.mean(-1), rtol=1e-4)


def test_without_tolerance_the_light_stays_as_it_was_fitted():
    torch.manual_seed(3)
    before, after = finished(0.0)
    np.testing.assert_array_equal(after, before)


def test_a_light_that_photos_show_themselves_stays_as_they_show_it():
    torch.manual_seed(3)
    before, after = finished(0.01, far="what is far away")
    np.testing.assert_array_equal(after, before)
