"""The GLB and its light stand upright where a placement says how; all else stays in the capture's world."""

import numpy as np
import pytest

from solver.asset.build import build_asset
from solver.asset.settings import AssetSettings
from solver.capture.photos import read_exr
from solver.light.turned import turned
from tests.asset.test_asset import LEVEL, ONE, attributes_of

SETTINGS = AssetSettings(cells=32, triangles=1000, texture_size=64)
LIGHT = np.random.default_rng(0).random((16, 32, 3)).astype(np.float32) * 5


def build(folder, placement):
    """Build the asset of a ball; the folder and its part of the manifest."""
    silent = lambda fraction, text: None  # noqa: E731
    return folder, build_asset(ONE, LIGHT, LEVEL, folder, SETTINGS, silent, "tea pot", placement)


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """As it was captured."""
    return build(tmp_path_factory.mktemp("as captured"), np.eye(4))


@pytest.fixture(scope="module")
def turned_over(tmp_path_factory):
    """The same, half the size and elsewhere, where up was −Y in the capture; and its placement."""
    placement = np.array([[0.5, 0, 0, 3], [0, 0, 0.5, 4], [0, -0.5, 0, 5], [0, 0, 0, 1]])
    return *build(tmp_path_factory.mktemp("turned over"), placement), placement


def test_the_glb_stands_where_the_placement_puts_it_and_all_else_as_it_was(built, turned_over):
    folder, parts, placement = turned_over
    assert parts["placement"] == placement.tolist()
    as_captured, placed = (attributes_of(f / "asset.glb") for f in (built[0], folder))
    from_gltf = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])  # +Y up to +Z up

    def moved(name):
        return as_captured[name][:, :3] @ from_gltf.T @ placement[:3, :3].T

    def shown(name):
        return placed[name][:, :3] @ from_gltf.T

    np.testing.assert_allclose(shown("POSITION"), moved("POSITION") + placement[:3, 3], atol=1e-6)
    np.testing.assert_allclose(shown("NORMAL"), 2 * moved("NORMAL"), atol=1e-6)
    np.testing.assert_allclose(shown("TANGENT"), 2 * moved("TANGENT"), atol=1e-3)
    for name in ("TEXCOORD_0", "indices"):
        np.testing.assert_array_equal(placed[name], as_captured[name])
    same = {path.name for path in built[0].iterdir()} - {"asset.glb"}
    for name in same:
        assert (folder / name).read_bytes() == (built[0] / name).read_bytes(), name


def test_the_light_is_there_upright_too_where_a_placement_turns_it(built, turned_over, tmp_path):
    folder, parts, placement = turned_over
    assert parts["environment_upright"] == {
        "file": "environment_upright.exr", "colour_space": "Linear Rec.709",
    }  # fmt: skip
    light, _ = read_exr(folder / "environment_upright.exr")
    np.testing.assert_array_equal(light, turned(LIGHT, 2 * placement[:3, :3]))
    assert "environment_upright" not in built[1]
    assert not (built[0] / "environment_upright.exr").exists()
    only_moved = np.diag([3.0, 3, 3, 1])
    build(tmp_path, only_moved)
    assert not (tmp_path / "environment_upright.exr").exists()
