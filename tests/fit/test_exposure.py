"""Exposure and white balance of photos shot on automatic."""

import dataclasses

import numpy as np
import pytest
import torch

from solver.capture.photos import Photo
from solver.fit import checkpoint
from solver.fit.errors import SettingsError
from solver.fit.exposure import Exposures, brought_to, exposures_for, photo_views
from solver.fit.presets import settings_for
from solver.fit.preview import display, over_plain
from solver.fit.schedule import picture_settings
from solver.fit.start import background_shown, new_trainer
from solver.metrics.image import psnr
from solver.render.image import render_view
from solver.render.scene import StepTables
from tests.fit.test_fit import SMALL, ball_capture, resumed


def uneven_capture(gains):
    """Photos of the ball, each times its gains [P, 3]."""
    capture, photos = ball_capture(len(gains))
    uneven = []
    for photo, gain in zip(photos, gains, strict=True):
        pixels = photo.pixels.copy()
        pixels[..., :3] *= gain
        uneven.append(Photo(pixels.astype(np.float32), True, False))
    return capture, uneven


def fitted(gains, kind, steps=260):
    settings = dataclasses.replace(SMALL, fit=dataclasses.replace(SMALL.fit, exposure=kind))
    capture, photos = uneven_capture(gains)
    trainer = new_trainer(capture, photos, settings, 0, None, "cpu", lambda fraction: None)
    losses = [trainer.advance(i / steps)["image"] for i in range(steps)]
    return trainer, float(np.mean(losses[-30:])), capture, photos, settings


GAINS = np.exp(0.25 * np.array([-1, 1, 0.5, -0.5, 0.8, -0.8, 0.2, -0.2, 0.6, -0.6]))


@pytest.fixture(scope="module")
def with_gains():
    """A fit that finds a gain for each photo; not to be gone on with."""
    return fitted(np.tile(GAINS[:, None], 3), "gain")


def test_gains_of_photos_are_found_and_the_fit_is_better_for_it(with_gains):
    trainer, loss, *_ = with_gains
    found = trainer.log_gain.exp()[:, 0].numpy()
    assert np.corrcoef(np.log(found), np.log(GAINS))[0, 1] > 0.97
    np.testing.assert_allclose(found.prod(), 1, rtol=1e-4)
    np.testing.assert_allclose(np.log(found), np.log(GAINS), atol=0.12)
    assert loss < 0.5 * fitted(np.tile(GAINS[:, None], 3), "fixed")[1]


def test_white_balance_finds_a_gain_for_each_channel():
    gains = np.stack([GAINS, np.ones(10), 1 / GAINS], axis=1)
    found = fitted(gains, "white_balance")[0].log_gain.exp().numpy()
    for channel, sign in ((0, 1), (2, -1)):
        assert np.corrcoef(np.log(found[:, channel]), sign * np.log(GAINS))[0, 1] > 0.95
    assert np.abs(np.log(found[:, 1])).max() < 0.1


def test_a_checkpoint_carries_the_exposures_on(tmp_path):
    trainer, _, capture, photos, settings = fitted(np.tile(GAINS[:, None], 3), "gain", steps=20)
    other, known = resumed(trainer, tmp_path, capture, photos)
    assert known == settings
    torch.testing.assert_close(other.exposures.log_gain, trainer.exposures.log_gain)
    losses = [t.advance(0.5)["image"] for t in (trainer, other)]
    assert losses[0] == pytest.approx(losses[1], rel=1e-5)
    torch.testing.assert_close(other.exposures.log_gain, trainer.exposures.log_gain)


def test_a_texture_that_is_baked_later_knows_the_exposures_of_the_fit(tmp_path):
    trainer, _, capture, photos, _ = fitted(np.tile(GAINS[:, None], 3), "gain", steps=8)
    checkpoint.save_checkpoint(trainer, tmp_path / "checkpoint", 1.0, done=True)
    kept = checkpoint.read_tensor(tmp_path / "checkpoint", "exposures.log_gain")
    torch.testing.assert_close(kept, trainer.log_gain)
    gains = [view.gain for view in photo_views(capture.cameras, photos, kept)]
    np.testing.assert_allclose(gains, trainer.log_gain.exp().numpy(), rtol=1e-6)
    assert checkpoint.read_tensor(tmp_path / "checkpoint", "none of this name") is None
    plain = photo_views(capture.cameras, photos, None)
    assert all((view.gain == 1).all() for view in plain)


def test_photos_without_rays_keep_their_exposure_but_for_the_common_mean():
    exposures = Exposures(4, 1)
    gradient = torch.tensor([[1.0], [0.0], [0.0], [0.0]])
    exposures.step([gradient, None], 1.0)
    log_gain = exposures.log_gain.detach()[:, 0]
    assert log_gain[0] < log_gain[1] == log_gain[2] == log_gain[3]
    assert float(log_gain.sum()) == pytest.approx(0, abs=1e-7)


def test_an_unknown_kind_of_exposure_is_named():
    with pytest.raises(SettingsError, match="fit.exposure.*bright.*gain"):
        settings_for("draft", {"fit.exposure": "bright"})
    assert exposures_for("fixed", 3) is None


def test_pictures_are_compared_with_photos_at_their_own_exposure(with_gains):
    trainer, _, capture, photos, _ = with_gains
    view = shown(trainer, capture.cameras[0])
    plain, exposed = (
        psnr(display(brought_to(view, photos[0], "white", kind)), over_plain(photos[0].pixels))
        for kind in ("fixed", "gain")
    )
    assert exposed > plain + 5
    brighter = dataclasses.replace(photos[0], pixels=photos[0].pixels * (1.2, 1, 0.8, 1))
    white = brought_to(view, brighter, "white", "white_balance")
    ratio = white.radiance.sum((0, 1)) / brought_to(view, photos[0], "white", "gain").radiance.sum((0, 1))
    np.testing.assert_allclose(ratio, (1.2, 1, 0.8), rtol=0.05)


def test_what_stood_before_black_is_shown_before_black():
    settings = dataclasses.replace(
        SMALL, fit=dataclasses.replace(SMALL.fit, background="black", emission_fade=(0.1, 0.2))
    )
    capture, photos = ball_capture()
    opaque = [np.concatenate([p.pixels[..., :3], np.ones_like(p.pixels[..., 3:])], -1) for p in photos]
    photos = [Photo(pixels, False, False) for pixels in opaque]
    trainer = new_trainer(capture, photos, settings, 0, None, "cpu", lambda fraction: None)
    for i in range(200):
        trainer.advance(i / 200)
    view = shown(trainer, capture.cameras[0])
    behind = background_shown(photos, trainer.background)
    assert psnr(display(view, behind), over_plain(photos[0].pixels, behind)) > 20


def test_photos_that_are_compared_need_not_be_those_of_the_fit():
    _, photos = ball_capture(2)
    opaque = [dataclasses.replace(photo, has_alpha=False) for photo in photos]
    assert background_shown(opaque, "random") == background_shown(photos, "room") == "white"
    assert background_shown(opaque, "room") == "room"


def shown(trainer, camera):
    trainer.refresh_occupancy()
    return render_view(
        trainer.scene, StepTables.of(trainer.scene), picture_settings(trainer.settings, 8), camera
    )
