"""Scores of materials against maps beside the photos."""

from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from solver.asset.files import write_exr, write_fine_png, write_png
from solver.capture.errors import CaptureError
from solver.fit.evaluate import image_scores
from solver.fit.material_scores import MaterialScores
from solver.fit.preview import over_plain
from solver.fit.truth import true_normals


def scores_of(folder, metalness, albedo=0.3, f0=0.45):
    """Scores and factor of one view of base colour 0.5 (sRGB 188), left and right half of a metalness."""
    size = (4, 6)
    Image.fromarray(np.full((*size, 3), 188, np.uint8)).save(folder / "a_albedo.png")
    metallic = np.repeat(np.repeat(np.uint8([metalness]), 3, axis=1), size[0], axis=0)
    Image.fromarray(metallic).save(folder / "a_metallic.png")
    camera = SimpleNamespace(name="a", image_path=folder / "a.png")
    view = SimpleNamespace(
        albedo=np.full((*size, 3), albedo), f0=np.full((*size, 3), f0), alpha=np.full(size, 0.1)
    )
    materials = MaterialScores()
    scores = materials.add(camera, view, np.ones(size))
    for _, errors in materials.albedo_errors():
        scores.update(errors)
    return materials.albedo_factor, scores


def test_what_is_metal_all_over_has_no_error_of_albedo(tmp_path):
    factor, scores = scores_of(tmp_path, (255, 255))
    assert factor is None and "albedo_mae" not in scores
    assert scores["f0_mae"] == pytest.approx(0.05, abs=0.005)


def test_what_is_metal_in_part_has_one(tmp_path):
    factor, scores = scores_of(tmp_path, (255, 0))
    np.testing.assert_allclose(factor, 0.25 / (0.3 * 0.55 / 0.96), rtol=0.02)
    assert scores["albedo_mae"] == pytest.approx(0.25, abs=0.005)


def test_half_a_metal_has_no_error_where_as_much_is_diffuse_as_of_principled(tmp_path):
    """There (1 − m) b gets 0.96 of the light; here a layer beside an F0 of 0.27 gets 0.73 of it."""
    factor, scores = scores_of(tmp_path, (128, 128), albedo=0.25 * 0.96 / 0.73, f0=0.27)
    np.testing.assert_allclose(factor, 1, rtol=0.02)
    assert scores["albedo_mae"] < 0.005 and scores["f0_mae"] < 0.005


def test_what_is_left_of_an_albedo_under_a_metals_gloss_counts_as_much_as_it_sends(tmp_path):
    """A metal beside plastic: both albedos are 0.5, but the metal's gets a tenth of the light."""
    f0 = np.where(np.arange(6) < 3, 0.904, 0.04)[:, None]
    factor, scores = scores_of(tmp_path, (255, 0), albedo=0.5, f0=f0)
    np.testing.assert_allclose(factor, (0.5 * 0.5) / (0.5**2 + 0.05**2), rtol=0.02)
    assert scores["albedo_mae"] == pytest.approx((0.05 + 0.005) / 2, abs=0.005)
    assert scores["own_albedo_mae"] == pytest.approx(0.25, abs=0.005)


def test_pictures_are_clipped_and_then_laid_over_their_background_in_srgb():
    lamp = np.array([[[2.0, 2.0, 2.0, 0.5]]])  # premultiplied: radiance 4
    np.testing.assert_allclose(over_plain(lamp), 1.0)
    np.testing.assert_allclose(over_plain(lamp, "black"), 0.5)
    dark = np.array([[[0.107, 0.107, 0.107, 0.5]]])
    np.testing.assert_allclose(over_plain(dark), 0.75, atol=1e-3)  # sRGB 0.5, half of it


def test_the_prediction_alone_is_rounded_to_eight_bits():
    one = np.full((16, 16, 3), 0.5)  # between two codes
    step = 0.5 / 255
    assert image_scores(one, one)["psnr"] == pytest.approx(-20 * np.log10(step))
    assert image_scores(one + 0.4 * step, one)["psnr"] == image_scores(one + step, one)["psnr"]


def test_true_normals_are_the_same_from_every_file_they_may_lie_in(tmp_path):
    normals = np.random.default_rng(0).normal(size=(5, 7, 3)).astype(np.float32)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    camera = SimpleNamespace(name="a", image_path=tmp_path / "a.png")
    assert true_normals(camera) is None
    for bits, kind in ((8, np.uint8), (16, np.uint16)):
        half = 2 ** (bits - 1)
        coded = np.round(normals * (half - 1) + half).astype(kind)
        (write_png if bits == 8 else write_fine_png)(tmp_path / "a_normal.png", coded / (2**bits - 1))
        np.testing.assert_allclose(true_normals(camera), normals, atol=0.51 / (half - 1))
    for stored in (normals, normals * 0.5 + 0.5):
        write_exr(tmp_path / "a_normal.exr", {"RGB": stored})
        np.testing.assert_allclose(true_normals(camera), normals, atol=2e-3)


def test_a_grey_picture_of_normals_is_refused(tmp_path):
    Image.fromarray(np.zeros((4, 4), np.uint8)).save(tmp_path / "a_normal.png")
    with pytest.raises(CaptureError, match=r"a_normal\.png"):
        true_normals(SimpleNamespace(name="a", image_path=tmp_path / "a.png"))
