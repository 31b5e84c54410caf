"""Metrics against closed forms."""

import math

import numpy as np
import pytest
import scipy.ndimage
import skimage.transform

from solver.capture.frames import direction_from_equirect
from solver.metrics.image import flip, lpips, ms_ssim, psnr, ssim
from solver.metrics.material import environment_errors, weighted_mae
from solver.metrics.normals import angles, normal_mae, normal_mae_masked
from solver.metrics.scale import LeastSquaresFactor, clipped_factor


def test_psnr_of_a_known_error():
    truth = np.zeros((4, 4, 3))
    assert math.isclose(psnr(truth + 0.1, truth), 20.0)
    assert psnr(truth, truth) == float("inf")


def test_ssim_is_one_for_equal_images_and_falls_with_noise():
    image = np.random.default_rng(0).random((32, 32, 3))
    noisy = image + 0.2 * np.random.default_rng(1).standard_normal(image.shape)
    assert math.isclose(ssim(image, image), 1.0)
    assert ssim(noisy, image) < 0.9


def test_angles_are_degrees_and_missing_normals_count_ninety():
    truth = np.array([[0, 0, 1.0]] * 3)
    prediction = np.array([[0, 0, 2.0], [0, 1, 1.0], [0, 0, 0.0]])
    np.testing.assert_allclose(angles(prediction, truth), (0, 45, 90), atol=1e-6)


def test_normal_mae_is_weighted_by_alpha():
    truth = np.array([[0, 0, 1.0]] * 2)
    prediction = np.array([[0, 1.0, 0], [0, 0, 1.0]])
    assert math.isclose(normal_mae(prediction, truth, np.array([0.25, 0.75])), 22.5)


def test_masked_normal_mae_leaves_out_the_silhouette_and_what_is_missing():
    truth = np.array([[[0, 0, 1.0]] * 3])
    prediction = np.array([[[0, 1.0, 1.0], [0, 0, 0.0], [1.0, 0, 0]]])
    alpha = np.array([[1.0, 1.0, 0.5]])
    assert math.isclose(normal_mae_masked(prediction, truth, alpha), 45.0)
    assert normal_mae_masked(prediction * 0, truth, alpha) is None


def picture(side=192):
    smooth = skimage.transform.resize(np.random.default_rng(0).random((12, 12, 3)), (side, side))
    return smooth.clip(0, 1)


def contrast_and_light(a, b):
    """SSIM's contrast-structure and luminance maps, where the window lies within the images."""

    def blur(x):
        taps = np.exp(-0.5 * (np.arange(-5, 6) / 1.5) ** 2)
        taps /= taps.sum()
        for axis in (0, 1):
            x = scipy.ndimage.correlate1d(x, taps, axis=axis)
        return x[5:-5, 5:-5]

    mean_a, mean_b = blur(a), blur(b)
    var_a, var_b = blur(a * a) - mean_a**2, blur(b * b) - mean_b**2
    cov = blur(a * b) - mean_a * mean_b
    contrast = (2 * cov + 0.03**2) / (var_a + var_b + 0.03**2)
    return contrast, (2 * mean_a * mean_b + 0.01**2) / (mean_a**2 + mean_b**2 + 0.01**2)


def test_ssim_agrees_with_its_definition():
    image = picture(48)
    noisy = (image + 0.1 * np.random.default_rng(1).standard_normal(image.shape)).clip(0, 1)
    contrast, light = contrast_and_light(noisy, image)
    assert math.isclose(ssim(noisy, image), (contrast * light).mean(), rel_tol=1e-9)


def reference_ms_ssim(a, b):
    """Wang et al. 2003, from single-scale SSIM's contrast-structure and luminance maps."""
    weights = [0.0448, 0.2856, 0.3001, 0.2363, 0.1333]
    per_channel = np.ones(3)
    for level, weight in enumerate(weights):
        contrast, light = contrast_and_light(a, b)
        value = (contrast * light if level == 4 else contrast).mean((0, 1))
        per_channel *= np.maximum(value, 0) ** weight
        a, b = (x.reshape(x.shape[0] // 2, 2, -1, 2, 3).mean((1, 3)) for x in (a, b))
    return per_channel.mean()


def test_ms_ssim_agrees_with_its_definition_and_is_absent_for_small_images():
    image = picture()
    noisy = (image + 0.1 * np.random.default_rng(1).standard_normal(image.shape)).clip(0, 1)
    assert math.isclose(ms_ssim(image, image), 1.0, abs_tol=1e-9)
    assert math.isclose(ms_ssim(noisy, image), reference_ms_ssim(noisy, image), abs_tol=2e-3)
    assert ms_ssim(image[:100], image[:100]) is None


def test_flip_is_zero_for_equal_images_and_one_for_black_against_white():
    image = picture(64)
    assert flip(image, image) == 0
    assert flip(np.zeros((32, 32, 3)), np.ones((32, 32, 3))) > 0.95
    assert flip(image, (image + 0.05).clip(0, 1)) < flip(image, (image + 0.2).clip(0, 1))


def test_lpips_is_a_distance_or_absent():
    value = lpips(picture(64), picture(64))
    assert value is None or abs(value) < 1e-5


def test_the_least_squares_factor_is_found_per_channel():
    generator = np.random.default_rng(0)
    fitted = LeastSquaresFactor()
    for _ in range(3):
        prediction = generator.random((5, 6, 3))
        fitted.add(prediction, prediction * (2.0, 0.5, 1.5))
    np.testing.assert_allclose(fitted.value, (2.0, 0.5, 1.5))
    noisy, truth = generator.random((50, 3)), generator.random((50, 3))
    other = LeastSquaresFactor()
    other.add(noisy, truth)
    for channel in range(3):
        expected = np.linalg.lstsq(noisy[:, channel : channel + 1], truth[:, channel], rcond=None)[0]
        np.testing.assert_allclose(other.value[channel], expected[0])
    assert LeastSquaresFactor().value.tolist() == [1, 1, 1]
    # One factor for all channels: of all their numbers as if they were one image.
    expected = np.linalg.lstsq(noisy.reshape(-1, 1), truth.ravel(), rcond=None)[0]
    np.testing.assert_allclose(other.common, expected[0])
    assert LeastSquaresFactor().common == 1


def test_weighted_mae_of_a_known_error():
    truth, weight = np.zeros((2, 2)), np.array([[1.0, 0.0], [1.0, 0.0]])
    assert weighted_mae(np.array([[0.1, 9.0], [0.3, 9.0]]), truth, weight) == pytest.approx(0.2)


def test_environment_errors_are_zero_up_to_a_factor_and_count_solid_angle():
    truth = np.random.default_rng(0).random((32, 64, 3)) + 0.1
    same = environment_errors(truth * (2.0, 3.0, 0.5), truth)
    assert same["relative_rmse"] < 1e-9 and same["mae_tonemapped"] < 1e-9
    # An error of 1 in the upper hemisphere of a light of 1: half the sphere, so √½ of the truth.
    v, u = np.mgrid[0:32, 0:64] + 0.5
    up = direction_from_equirect(np.stack([u / 64, v / 32], -1))[..., 2] > 0
    ones = np.ones((32, 64, 3))
    errors = environment_errors(ones + up[..., None], ones, factor=np.ones(3))
    assert errors["relative_rmse"] == pytest.approx(0.5**0.5, abs=1e-3)
    assert errors["mae_tonemapped"] == pytest.approx(0.5 * (2 / 3 - 1 / 2), abs=1e-3)
    # In the rows above 60° of latitude, which are a sixth of all rows, it is a fifteenth of the sphere.
    cap = np.zeros((36, 72, 3))
    cap[:6] = 1
    errors = environment_errors(1 + cap, np.ones((36, 72, 3)), factor=np.ones(3))
    share = (1 - math.cos(math.pi / 6)) / 2
    assert errors["relative_rmse"] == pytest.approx(share**0.5, rel=0.01)
    assert errors["mae_tonemapped"] == pytest.approx(share * (2 / 3 - 1 / 2), rel=0.01)


def test_the_clipped_factor_is_not_fooled_by_a_misplaced_lamp():
    generator = np.random.default_rng(0)
    truth = generator.random((4000, 3)) * 0.6
    prediction = truth / (2.0, 0.5, 1.2)
    prediction[:20], truth[20:40] = 400.0, 300.0  # a lamp's reflection, twenty pixels off
    np.testing.assert_allclose(clipped_factor(prediction, truth), (2.0, 0.5, 1.2), rtol=0.02)
    plain = LeastSquaresFactor()
    plain.add(prediction, truth)
    assert (plain.value < 0.2).all()
