"""Metrics against closed forms."""

import math

import numpy as np

from solver.metrics.image import psnr, ssim
from solver.metrics.normals import angles, normal_mae


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
