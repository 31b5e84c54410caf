"""The light that points begin to reflect, as the room before it has it."""

import dataclasses

import numpy as np
import pytest
import torch

from solver.field.room import EXTENT
from solver.fit.light_start import BRIGHTEST, WHITE, light_from_room
from solver.fit.losses import LEAST_LIGHT
from solver.fit.seen_space import cell_centres
from solver.fit.start import new_trainer
from solver.light.environment import equirect_directions
from solver.light.spherical_harmonics import sh_basis
from solver.render.surroundings import light_of_room
from tests.fit.test_fit import SMALL, resumed
from tests.fit.test_fog import walled_capture
from tests.render.test_surroundings import room

CELLS = 32
SHINE_UNTIL = 0.5


def walls(there, colour=(0.3, 0.2, 0.1)):
    """A room of opaque walls of one colour in those directions [N, 3] from its centre that `there` holds."""
    cells = cell_centres(np.array([[-EXTENT] * 3, [EXTENT] * 3]), CELLS)
    directions = cells / np.linalg.norm(cells, axis=1, keepdims=True)
    made = room(density=200.0, allowed=torch.from_numpy(there(directions)).view((CELLS,) * 3))
    with torch.no_grad():
        made.colour_planes.zero_()
        made.basis.bias.copy_(torch.tensor(colour).log())
    return made


def looked_at(height, there):
    directions = equirect_directions(height, 2 * height).numpy()
    return there(directions.reshape(-1, 3)).reshape(height, 2 * height)


def test_where_a_room_is_known_all_round_the_light_is_the_room():
    light = light_from_room(walls(lambda d: d[:, 0] < 2), 64)
    np.testing.assert_allclose(light.image(), np.broadcast_to([0.3, 0.2, 0.1], (64, 128, 3)), rtol=1e-3)


@pytest.mark.parametrize("height", [32, 128])
def test_what_no_photo_shows_is_grey_and_makes_white_surfaces_white(height):
    image = light_from_room(walls(lambda d: d[:, 2] < 0.3), height).image()
    walled, sky = (looked_at(height, there) for there in (lambda d: d[:, 2] < 0.2, lambda d: d[:, 2] > 0.8))
    np.testing.assert_allclose(
        image[walled], np.broadcast_to([0.3, 0.2, 0.1], image[walled].shape), rtol=0.02
    )
    grey = image[sky]
    assert np.ptp(grey) < 0.02 * grey.mean() and grey.mean() > 1
    sine = np.sin((np.arange(height) + 0.5) * np.pi / height)[:, None, None]
    assert (image * sine).mean() / sine.mean() == pytest.approx(WHITE, rel=0.02)


def test_a_gap_in_the_room_has_the_colours_around_it():
    gap = np.array([0.6, 0.64, 0.48])
    image = light_from_room(walls(lambda d: d @ gap < np.cos(0.12)), 64).image()
    np.testing.assert_allclose(image, np.broadcast_to([0.3, 0.2, 0.1], image.shape), rtol=0.02)


def test_what_no_photo_shows_is_no_brighter_than_a_limit_and_no_darkness_is_a_hole():
    image = light_from_room(walls(lambda d: d[:, 2] < 0.7, (1e-5, 1e-5, 1e-5)), 64).image()
    assert image.max() == pytest.approx(BRIGHTEST, rel=0.01)
    assert image.min() == pytest.approx(LEAST_LIGHT, rel=0.01)


def test_colours_stay_in_their_direction():
    made = walls(lambda d: d[:, 0] < 2)
    with torch.no_grad():
        made.colour_planes.normal_(std=0.5)
    image = light_from_room(made, 128).image()
    # Rotating or mirroring the map would turn its first harmonics.
    directions = equirect_directions(128, 256)
    with torch.no_grad():
        seen, _ = light_of_room(made, directions.float().view(-1, 3), torch.full((128 * 256,), 0.5))
    texels = torch.sin((torch.arange(128) + 0.5) * np.pi / 128)[:, None, None]
    basis = sh_basis(directions, 2).float()

    def harmonics(colours):
        return torch.einsum("hwk,hwc->kc", basis * texels, colours)

    theirs = harmonics(seen.view(128, 256, 3))
    ours = harmonics(torch.from_numpy(image))
    torch.testing.assert_close(ours, theirs, rtol=0.02, atol=0.01 * float(theirs.abs().max()))


def trainer_of(capture, photos, from_room=True):
    settings = dataclasses.replace(
        SMALL,
        fit=dataclasses.replace(SMALL.fit, background="room", emission_fade=(SHINE_UNTIL, 0.8)),
        light=dataclasses.replace(SMALL.light, from_room=from_room),
    )
    return new_trainer(capture, photos, settings, 0, None, "cpu", lambda fraction: None)


@pytest.mark.parametrize("from_room", [True, False])
def test_when_points_begin_to_reflect_the_light_is_the_rooms(from_room):
    capture, photos = walled_capture(6)
    trainer = trainer_of(capture, photos, from_room)
    steps = 40
    for i in range(20):
        trainer.advance(i / steps)

    def away():
        """How far the light is from the room, in logarithms."""
        room_light = light_from_room(trainer.scene.room, trainer.scene.environment.height)
        own = trainer.scene.environment.log_radiance
        return float((room_light.log_radiance - own).detach().abs().mean())

    shining = away()
    trainer.advance(SHINE_UNTIL + 1 / steps)
    assert away() < 0.3 * shining if from_room else away() > 0.8 * shining


def test_the_light_begins_once_even_if_the_job_is_resumed(tmp_path):
    capture, photos = walled_capture(6)
    trainer = trainer_of(capture, photos)
    for i in range(22):
        trainer.advance(i / 40)
    with torch.no_grad():
        trainer.scene.environment.log_radiance.fill_(-1.0)
    other, _ = resumed(trainer, tmp_path, capture, photos)
    for one in (trainer, other):
        one.advance(22 / 40)
        assert float((one.scene.environment.log_radiance.detach() + 1).abs().max()) < 0.1
