"""Several rays through a pixel: where they go, and that a pixel is their mean."""

import dataclasses

import numpy as np
import pytest
import torch

from solver.capture.camera import Camera
from solver.capture.photos import Photo
from solver.fit.ray_bank import RayBank
from solver.render.image import image_settings
from solver.render.pixels import halves_of_rays, keys_of_rays, mean_of_rays, places_in_pixel
from solver.render.scene import RenderSettings
from tests.render.test_invariance import SETTINGS, camera, lumpy, picture


@pytest.mark.parametrize("grid", [1, 2, 3])
def test_rays_fill_a_pixel_evenly(grid):
    places = places_in_pixel(grid)
    assert places.shape == (grid * grid, 2)
    np.testing.assert_allclose(places.mean(0), 0, atol=1e-12)
    np.testing.assert_allclose(np.unique(places[:, 0]), (np.arange(grid) + 0.5) / grid - 0.5)


def test_the_rays_of_a_pixel_stand_together():
    keys = keys_of_rays(torch.tensor([0, 3, 1]), 4)
    assert len(set(keys.tolist())) == 12
    np.testing.assert_allclose(mean_of_rays((keys // 4).float(), 4), [0, 3, 1])


@pytest.mark.parametrize("grid", [2, 3, 4])
def test_both_halves_of_a_pixel_have_the_mean_of_what_slopes_evenly(grid):
    places = torch.tensor(places_in_pixel(grid))
    slopes = torch.tensor([[0.7, -1.1], [0.2, 3.0]], dtype=torch.float64)
    values = torch.cat([2.0 + places @ slope for slope in slopes])[:, None]
    halves = halves_of_rays(values.float(), grid * grid)
    assert halves.shape == (2, 2, 1)
    torch.testing.assert_close(halves, torch.full_like(halves, 2.0))


def test_each_ray_of_a_pixel_counts_in_one_of_its_halves():
    values = torch.eye(9)
    first, second = halves_of_rays(values, 9)[0]
    assert torch.equal((first > 0).int() + (second > 0).int(), torch.ones(9).int())
    assert first.sum() == pytest.approx(1) and second.sum() == pytest.approx(1)


def test_a_pixel_of_four_rays_is_four_pixels_of_twice_the_resolution():
    scene, fine, coarse = lumpy(), camera(32), camera(16)
    four = dataclasses.replace(SETTINGS, pixel_grid=2, secondary_rays=64)
    # A pixel of either covers what its rays stand for, a quarter of the coarse one.
    expected = picture(scene, fine, dataclasses.replace(four, pixel_grid=1))
    found = picture(scene, coarse, four)

    def halved(image):
        return image.reshape(16, 2, 16, 2, *image.shape[2:]).mean((1, 3))

    np.testing.assert_allclose(found.opacity, halved(expected.opacity), atol=1e-5)
    noise = np.abs(found.radiance - halved(expected.radiance))
    assert noise.mean() < 0.003 and found.radiance.mean() > 0.1


def test_secondary_rays_are_shared_among_those_through_a_pixel():
    assert image_settings(RenderSettings(pixel_grid=2), 64).secondary_rays == 16
    assert image_settings(RenderSettings(), 64).secondary_rays == 64
    assert image_settings(RenderSettings(pixel_grid=2), 1).secondary_rays == 1


@pytest.mark.parametrize("model, distortion", [("pinhole", ()), ("opencv", (-0.2, 0.05, 1e-3, 2e-3))])
def test_a_banks_rays_are_the_cameras_also_in_the_last_row_and_column(model, distortion):
    pose = np.eye(4)
    pose[:3, 3] = 1, 2, 3
    lenses = [
        Camera("a", None, pose, 40, 30, 50.0, 48.0, 20.0, 15.0, model, distortion),
        Camera("b", None, pose, 30, 40, 50.0, 48.0, 14.0, 21.0, model, distortion),
    ]
    photos = [Photo(np.ones((c.height, c.width, 4), np.float32), False, False) for c in lenses]
    bank = RayBank(lenses, photos)
    for lens, first in zip(lenses, bank.first_pixel, strict=False):
        row, column = np.mgrid[0 : lens.height, 0 : lens.width]
        batch = bank.batch(first + torch.arange(lens.width * lens.height), 2)
        for n, (x, y) in enumerate(places_in_pixel(2)):
            _, expected = lens.rays(column.ravel() + 0.5 + x, row.ravel() + 0.5 + y)
            # A lens bends the step between pixels; 2e-4 of a radian is a hundredth of one.
            np.testing.assert_allclose(batch.directions[:, n], expected, atol=2e-4)
        single = bank.batch(first + torch.arange(lens.width * lens.height))
        _, centres = lens.rays(column.ravel() + 0.5, row.ravel() + 0.5)
        np.testing.assert_allclose(single.directions[:, 0], centres, atol=1e-6)
