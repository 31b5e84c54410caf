"""Objects before what is far away: masks, the first light, and what is held to it."""

import dataclasses

import numpy as np
import pytest
import scipy.ndimage
import torch

from solver.capture.panorama import Panorama
from solver.capture.photos import linear_to_srgb, load_photos, srgb_to_linear
from solver.capture.read import read_capture
from solver.fit.before_far import before_panorama, cut_out_before_far
from solver.fit.cut_out import photos_as_fitted
from solver.fit.far_light import FarLight, SeenLight
from solver.fit.losses import SATURATED
from solver.fit.panorama_file import read_panorama, write_panorama
from solver.fit.ray_bank import RayBank
from solver.fit.start import new_trainer
from solver.light.environment import EnvironmentMap, equirect_directions
from solver.render.random_numbers import RandomNumbers
from solver.render.scene import StepTables
from tests.capture.far_scene import RADIUS, WALL, far_colour, far_scene
from tests.capture.printed_table import camera_at, write_table
from tests.fit.test_fit import SMALL


@pytest.fixture(scope="module")
def scene():
    capture, photos, coverages = far_scene()
    return capture, photos, coverages, cut_out_before_far(capture, photos)


def off(photo, coverage):
    """Share of the object by which a mask is wrong a pixel or more beside its outline, and sure of it."""
    around = scipy.ndimage.binary_dilation(coverage > 0, np.ones((3, 3)))
    within = scipy.ndimage.binary_erosion(coverage == 1, np.ones((3, 3)))
    shown = photo.pixels[..., 3] > 0.5
    return (((shown & ~around) | (within & ~shown)) & ~photo.unsure).sum() / (coverage > 0.5).sum()


def test_an_object_before_what_is_far_away_is_cut_out(scene):
    _, photos, coverages, found = scene
    errors = [off(p, c) for p, c in zip(found.photos, coverages, strict=True)]
    assert max(errors) < 0.1 and np.mean(errors) < 0.02
    for photo, original in zip(found.photos, photos, strict=True):
        assert photo.has_alpha and (photo.pixels[photo.pixels[..., 3] == 0] == 0).all()
        inside = photo.pixels[..., 3] == 1
        np.testing.assert_array_equal(photo.pixels[inside], original.pixels[inside])


def test_photos_stay_as_they_are_in_a_room_and_where_they_have_alpha(scene):
    capture, photos, _ = far_scene(wall=WALL)
    assert cut_out_before_far(capture, photos) is None
    capture, _, _, found = scene
    assert cut_out_before_far(capture, found.photos) is None


def test_an_object_that_is_the_same_everywhere_is_no_surroundings():
    """Photos from nearby show a plain object in the same directions, in the same colour."""
    capture, photos, coverages = far_scene(paint=lambda points: np.full_like(points, 0.3))
    found = cut_out_before_far(capture, photos)
    errors = [off(p, c) for p, c in zip(found.photos, coverages, strict=True)]
    assert np.mean(errors) < 0.02


def test_ground_that_is_even_in_part_is_no_surroundings(tmp_path):
    """A table of fine print that fills every photo: some of it is grey in all of them."""
    cameras = [camera_at(angle) for angle in np.linspace(0, 3.0, 14)]
    capture = read_capture(write_table(tmp_path, cameras))
    photos = load_photos(capture, lambda *done: None)
    assert cut_out_before_far(capture, photos) is None


def test_photos_that_were_held_out_are_cut_out_before_the_panorama(scene):
    *_, found = scene
    capture, photos, coverages = far_scene(views=12, turn=0.4)
    settings = dataclasses.replace(SMALL, fit=dataclasses.replace(SMALL.fit, cut_out=True))
    for views in (12, 1):
        some = dataclasses.replace(capture, cameras=capture.cameras[:views])
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("solver.fit.cut_out.load_photos", lambda *a, n=views, **k: photos[:n])
            cut = photos_as_fitted(some, settings, True, None, found.panorama)
        errors = []
        for photo, coverage in zip(cut, coverages, strict=False):
            errors.append(off(photo, coverage))
        assert np.mean(errors) < 0.05
    assert before_panorama(capture.cameras, photos, found.panorama, capture.region) is not None


def test_photos_are_compared_with_what_is_behind_the_object(scene):
    capture, photos, _, found = scene
    bank = RayBank(list(capture.cameras), found.photos)
    pixels = torch.arange(len(bank))
    batch = bank.batch(pixels)
    assert bank.batch(pixels[:5], 2).behind.shape == (5, 3)
    raw = torch.cat([torch.from_numpy(p.pixels[..., :3]).reshape(-1, 3) for p in photos])
    alpha = batch.alpha[:, None]
    laid = batch.colour * alpha + (1 - alpha) * batch.behind
    # Over what is behind it, a photo that was cut out is what it was.
    away = (laid - torch.from_numpy(linear_to_srgb(raw.numpy()))).abs().amax(-1)
    assert float(away.mean()) < 0.01
    parts = batch.split([1000, len(bank) - 1000])
    assert torch.equal(torch.cat([part.behind for part in parts]), batch.behind)


def linear_far(height):
    directions = equirect_directions(height, 2 * height).numpy().reshape(-1, 3)
    return srgb_to_linear(far_colour(directions)).reshape(height, 2 * height, 3)


def test_the_first_light_is_what_photos_show(scene):
    capture, _, _, found = scene
    trainer = new_trainer(
        capture, found.photos, SMALL, 0, None, "cpu", lambda done: None, SeenLight(found.panorama)
    )
    light = trainer.scene.environment.image()
    error = np.abs(light - linear_far(len(light)))
    assert np.median(error) < 0.03
    assert trainer.background == "white" and trainer.scene.room is None


def test_known_light_comes_back_on_a_finer_map(scene):
    *_, found = scene
    far = FarLight(found.panorama)
    environment = EnvironmentMap(128, 0.5)
    far.put_into(environment)
    known = np.abs(environment.image() - 0.5).max(-1) > 1e-6
    assert known.mean() > 0.7
    assert np.median(np.abs(environment.image() - linear_far(128))[known]) < 0.02


def test_a_coarse_light_has_means_of_what_is_known_and_keeps_its_own_where_that_is_white():
    generator = np.random.default_rng(1)
    colour = generator.uniform(0.2, 0.8, (256, 512, 3)).astype(np.float32)
    colour[100, 200] = 1.0
    known = np.ones((256, 512), bool)
    known[:64] = False
    environment = EnvironmentMap(64, 3.0)
    FarLight(Panorama(colour * known[..., None], known)).put_into(environment)
    image = environment.image()
    means = srgb_to_linear(colour).reshape(64, 4, 128, 4, 3).mean((1, 3))
    own = np.zeros((64, 128), bool)
    own[:16] = own[25, 50] = True
    np.testing.assert_allclose(image[~own], means[~own], rtol=1e-4)
    np.testing.assert_allclose(image[own], 3.0, rtol=1e-5)


def test_the_light_is_held_to_what_is_known_but_may_be_brighter_where_that_is_white(scene):
    capture, _, _, found = scene
    white = dataclasses.replace(found.panorama, colour=np.ones_like(found.panorama.colour))

    def difference(panorama, level):
        trainer = new_trainer(
            capture,
            found.photos,
            SMALL,
            0,
            None,
            "cpu",
            lambda done: None,
            SeenLight(found.panorama),
        )
        with torch.no_grad():
            trainer.scene.environment.log_radiance.fill_(float(np.log(level)))
        tables = StepTables.of(trainer.scene)
        value = FarLight(panorama).difference(
            trainer.scene, tables, RandomNumbers(0, "cpu").at(0), torch.arange(2000)
        )
        value.backward()
        return float(value.detach()), trainer.scene.environment.log_radiance.grad

    brighter, gradient = difference(white, 20.0)
    assert brighter == 0 and (gradient == 0).all()
    dimmer, gradient = difference(white, 0.1)
    share = FarLight(white).known.float().mean()  # of the map, which is not even on the sphere
    assert dimmer == pytest.approx(float(share) * np.log(10) ** 2, rel=0.1) and float(gradient.sum()) < 0
    assert SATURATED < 1


def test_a_jobs_surroundings_come_back_from_their_file(scene, tmp_path):
    *_, found = scene
    assert read_panorama(tmp_path / "surroundings.exr") is None
    write_panorama(tmp_path / "surroundings.exr", found.panorama)
    again = read_panorama(tmp_path / "surroundings.exr")
    np.testing.assert_array_equal(again.known, found.panorama.known)
    np.testing.assert_allclose(again.colour, found.panorama.colour, atol=1e-5)


def test_surroundings_that_swallow_a_part_of_the_object_leave_photos_as_they_are():
    """One side of the ball shines white in a white world, from wherever one looks."""
    capture, photos, _ = far_scene(
        paint=lambda points: np.where(points[:, :1] > 0, 1.0, 0.2 * points + 0.4)
    )
    white = []
    for photo, camera in zip(photos, capture.cameras, strict=True):
        pixels = photo.pixels.copy()
        row, column = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
        origins, directions = camera.rays(column.ravel(), row.ravel())
        closest = np.linalg.norm(np.cross(origins, directions), axis=1).reshape(row.shape)
        pixels[closest > RADIUS, :3] = 1
        white.append(dataclasses.replace(photo, pixels=pixels))
    assert cut_out_before_far(capture, white) is None
