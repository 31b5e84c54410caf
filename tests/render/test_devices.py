"""Every device gives the same numbers within tolerance; devices that are not there are skipped."""

import numpy as np
import pytest
import torch

from solver.fit.presets import settings_for
from solver.fit.start import new_trainer
from solver.kernels.backend import forced_path, plain_torch
from solver.kernels.hashing import uniform
from tests.fit.test_fit import SMALL, ball_capture
from tests.fit.test_method import SMALL_PAPER
from tests.kernels.paths import WITHOUT_CARD
from tests.render.test_invariance import camera, lumpy, picture

WITHOUT_MPS = pytest.mark.skipif(not torch.backends.mps.is_available(), reason="no MPS")
DEVICES = ["cpu", pytest.param("cuda", marks=WITHOUT_CARD), pytest.param("mps", marks=WITHOUT_MPS)]
WAYS = [
    pytest.param("torch", "cpu", id="torch-cpu"),
    pytest.param("warp", "cpu", id="warp-cpu"),
    pytest.param("torch", "cuda", id="torch-cuda", marks=WITHOUT_CARD),
    pytest.param("warp", "cuda", id="warp-cuda", marks=WITHOUT_CARD),
    pytest.param("torch", "mps", id="torch-mps", marks=WITHOUT_MPS),
]


@pytest.mark.parametrize("device", DEVICES)
def test_random_numbers_are_the_same_bits(device):
    keys = torch.arange(1000) * 4096 + 7
    with plain_torch():
        result = uniform(keys.to(device), 3, 2)
    assert torch.equal(result.cpu(), uniform(keys, 3, 2))


@pytest.mark.parametrize("path, device", WAYS)
def test_a_picture_is_the_same(path, device):
    expected = picture(lumpy(), camera())
    scene = lumpy().to(device)
    with forced_path(path):
        result = picture(scene, camera())
    for name in ("radiance", "opacity", "albedo", "alpha", "f0"):
        error = np.abs(getattr(result, name) - getattr(expected, name))
        assert error.mean() < 2e-3, name
    both = (expected.opacity > 0.9) & (result.opacity > 0.9)
    cosine = (result.normal * expected.normal).sum(-1)[both]
    assert cosine.mean() > 0.999


@pytest.mark.parametrize("preset", ["draft", "paper"])
@pytest.mark.parametrize("path, device", WAYS)
def test_a_fit_learns_the_same(path, device, preset):
    settings = SMALL if preset == "draft" else settings_for("paper", SMALL_PAPER)
    capture, photos = ball_capture()

    def losses(device):
        trainer = new_trainer(capture, photos, settings, 0, None, device, lambda fraction: None)
        return [trainer.advance(i / 12)["image"] for i in range(8)]

    expected = losses("cpu")
    with forced_path(path):
        result = losses(device)
    np.testing.assert_allclose(result, expected, rtol=0.05)
