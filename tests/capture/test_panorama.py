"""What is far behind an object: photos agree about it, and make a panorama of it."""

import numpy as np
import pytest

from solver.capture.frames import direction_from_equirect
from solver.capture.panorama import Comparison, Panorama, panorama_of
from solver.capture.photos import linear_to_srgb
from tests.capture.far_scene import WALL, far_colour, far_scene


def levels(photos):
    return [linear_to_srgb(photo.pixels[..., :3]).astype(np.float32) for photo in photos]


@pytest.fixture(scope="module")
def scene():
    capture, photos, coverages = far_scene()
    return capture.cameras, levels(photos), [coverage > 0 for coverage in coverages]


def directions_of(height):
    row, column = np.mgrid[0:height, 0 : 2 * height] + 0.5
    return direction_from_equirect(np.stack([column / (2 * height), row / height], axis=-1))


def test_surroundings_are_far_if_they_have_no_parallax_and_only_then(scene):
    cameras, colours, _ = scene
    assert Comparison(cameras, colours).is_far()
    capture, photos, _ = far_scene(wall=WALL)
    assert not Comparison(capture.cameras, levels(photos)).is_far()


def test_photos_agree_about_what_is_behind_and_not_about_the_object(scene):
    cameras, colours, shown = scene
    comparison = Comparison(cameras, colours)
    for index in (8, 19, 31):
        found = comparison.agreement(index)
        told = found.seen > 0
        assert found.is_far[~shown[index] & told].mean() > 0.9
        assert found.is_far[shown[index] & told].mean() < 0.05


def test_a_panorama_has_the_colours_of_its_directions(scene):
    cameras, colours, shown = scene
    found = panorama_of(cameras, colours, shown)
    assert found.colour.shape == (found.height, 2 * found.height, 3) and found.known.mean() > 0.8
    truth = far_colour(directions_of(found.height).reshape(-1, 3)).reshape(found.colour.shape)
    error = np.abs(found.colour - truth)[found.known]
    assert error.mean() < 0.01 and np.percentile(error, 99) < 0.06
    assert (found.colour[~found.known] == 0).all()


def test_a_smaller_panorama_has_means_of_what_is_known():
    generator = np.random.default_rng(0)
    colour = generator.random((8, 16, 3)).astype(np.float32)
    known = np.ones((8, 16), bool)
    known[:2, :1] = False  # half of the first block
    known[2:4, :2] = False  # all of the one below it
    known[4:5, :2] = known[5:6, :1] = False  # all but a quarter
    small = Panorama(colour * known[..., None], known).smaller(4)
    np.testing.assert_allclose(small.colour[0, 0], colour[:2, 1].mean(0), rtol=1e-6)
    np.testing.assert_allclose(small.colour[3, 5], colour[6:, 10:12].mean((0, 1)), rtol=1e-6)
    assert small.known[0, 0] and not small.known[1, 0] and not small.known[2, 0]
    assert small.known.sum() == small.known.size - 2 and (small.colour[1, 0] == 0).all()


def test_what_is_behind_a_photo_is_seen_in_it_where_the_object_is_not(scene):
    cameras, colours, shown = scene
    others = panorama_of(cameras[1:], colours[1:], shown[1:])
    behind = others.behind(cameras[0], colours[0].shape[:2])
    seen = behind.is_seen_in(colours[0])
    assert seen[~shown[0] & behind.known].mean() > 0.97
    assert seen[shown[0]].mean() < 0.03


def test_a_panorama_has_no_seam(scene):
    """A photo that looks along −x, where the map begins and ends, has as much of it as others."""
    cameras, colours, shown = scene
    found = panorama_of(cameras, colours, shown)
    column = np.abs(np.diff(np.concatenate([found.colour[:, -1:], found.colour[:, :1]], 1), axis=1))
    usual = np.abs(np.diff(found.colour, axis=1)).mean()
    assert column.mean() < 3 * usual and found.known[:, [0, -1]].mean() > 0.7
