"""Scores of materials against maps beside the photos."""

from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from solver.fit.evaluate import _material_scores


def scores_of(folder, metalness):
    """Scores and factor of one view of base colour 0.5 (sRGB 188), left and right half of a metalness."""
    size = (4, 6)
    Image.fromarray(np.full((*size, 3), 188, np.uint8)).save(folder / "a_albedo.png")
    metallic = np.repeat(np.repeat(np.uint8([metalness]), 3, axis=1), size[0], axis=0)
    Image.fromarray(metallic).save(folder / "a_metallic.png")
    camera = SimpleNamespace(name="a", image_path=folder / "a.png")
    view = SimpleNamespace(
        albedo=np.full((*size, 3), 0.3), f0=np.full((*size, 3), 0.45), alpha=np.full(size, 0.1)
    )
    photo = SimpleNamespace(pixels=np.ones((*size, 4)))
    views = {"a": {}}
    return _material_scores([(camera, view)], [photo], views), views["a"]


def test_what_is_metal_all_over_has_no_error_of_albedo(tmp_path):
    factor, scores = scores_of(tmp_path, (255, 255))
    assert factor is None and "albedo_mae" not in scores
    assert scores["f0_mae"] == pytest.approx(0.05, abs=0.005)


def test_what_is_metal_in_part_has_one(tmp_path):
    factor, scores = scores_of(tmp_path, (255, 0))
    np.testing.assert_allclose(factor, 0.25 / 0.3, rtol=0.02)
    assert scores["albedo_mae"] == pytest.approx(0.25, abs=0.005)
