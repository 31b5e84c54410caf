"""Materials where no photo tells them."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from solver.asset.bake import SurfaceSamples
from solver.asset.build import build_asset
from solver.asset.from_scene import SceneSurface
from solver.asset.settings import AssetSettings
from solver.asset.unknown import spread_into_unknown, with_unknown
from solver.asset.unwrap import UnwrappedMesh, rasterise
from solver.capture.decoding import decode
from solver.capture.photos import srgb_to_linear
from tests.asset.test_asset import LEVEL, Balls
from tests.asset.test_from_scene import cameras
from tests.render.scenes import ball


def noise(count, seed=0):
    random = np.random.default_rng(seed)
    values = random.uniform(0.1, 0.9, (count, 7)).astype(np.float32)
    normals = np.tile(np.float32([0, 0, 1]), (count, 1))
    return SurfaceSamples(values[:, :3], values[:, 3], values[:, 4:], normals)


def values_of(samples):
    return np.column_stack([samples.albedo, np.sqrt(samples.alpha), samples.f0])


def one_by_one(mesh, samples, known):
    """Each unknown vertex becomes the mean of its neighbours, by 1 / distance, over and over."""
    values = values_of(samples).astype(np.float64)
    for _ in range(3000):
        for vertex in np.flatnonzero(~known):
            near = mesh.vertex_neighbors[vertex]
            weights = 1 / np.linalg.norm(mesh.vertices[near] - mesh.vertices[vertex], axis=1)
            values[vertex] = weights @ values[near] / weights.sum()
    return values


def test_unknown_materials_are_the_means_of_their_neighbours():
    mesh = trimesh.creation.icosphere(subdivisions=2)
    mesh.vertices *= (1, 1.5, 0.7)  # edges of many lengths
    samples, known = noise(len(mesh.vertices)), mesh.vertices[:, 2] > -0.2
    spread = values_of(spread_into_unknown(mesh, samples, known))
    np.testing.assert_array_equal(spread[known][:, :3], samples.albedo[known])
    np.testing.assert_allclose(spread, one_by_one(mesh, samples, known), atol=2e-5)


def test_unknown_materials_lie_between_those_that_are_known():
    mesh = trimesh.creation.icosphere(subdivisions=4)
    samples, known = noise(len(mesh.vertices)), mesh.vertices[:, 0] > 0.5
    spread = values_of(spread_into_unknown(mesh, samples, known))
    low, high = spread[known].min(0), spread[known].max(0)
    assert (spread >= low - 1e-5).all() and (spread <= high + 1e-5).all()
    # Far from what is known little is left of its noise.
    behind = mesh.vertices[:, 0] < -0.5
    assert spread[behind].std(0).max() < 0.15 * spread[known].std(0).min()


def test_a_part_that_no_photo_shows_gets_the_mean_of_what_it_has():
    one, other = trimesh.creation.icosphere(2), trimesh.creation.icosphere(2)
    other.apply_translation((5, 0, 0))
    both = trimesh.util.concatenate([one, other])
    samples, known = noise(len(both.vertices)), both.vertices[:, 0] < 2
    spread = values_of(spread_into_unknown(both, samples, known))
    assert spread[~known].std(0).max() < 1e-3
    assert np.abs(spread[~known].mean(0) - values_of(samples)[~known].mean(0)).max() < 0.02
    np.testing.assert_array_equal(spread[known][:, :3], samples.albedo[known])


def test_where_all_is_known_nothing_changes():
    mesh, samples = trimesh.creation.icosphere(1), noise(42)
    assert spread_into_unknown(mesh, samples, np.ones(42, dtype=bool)) is samples


@pytest.mark.parametrize("told", [True, False])
def test_a_side_that_photos_show_keeps_its_texture_though_its_lower_corners_look_away(told):
    corners = np.float32([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]])
    side = UnwrappedMesh(
        corners, np.float32([[0, -1, 0]] * 4), corners[:, [0, 2]] * 0.8 + 0.1,
        np.int32([[0, 1, 2], [0, 2, 3]]), np.arange(4),
    )  # fmt: skip
    texels = rasterise(side, 32)
    texture, at_corners = noise(len(texels.row)), noise(4, 1)
    known = corners[:, 2] > 0.5
    baked = with_unknown(
        texture, at_corners, known, side, texels, lambda chosen: np.full(len(chosen), told)
    )
    height = texels.interpolate(side, corners)[:, 2:]
    between = height * texture.albedo + (1 - height) * texels.interpolate(side, at_corners.albedo)
    np.testing.assert_allclose(baked.albedo, texture.albedo if told else between, atol=2e-3)


def test_the_underside_is_baked_as_what_is_around_it_and_not_as_the_noise_in_the_field(tmp_path):
    class Standing(Balls):
        """Photos show it from above; there it is 0.6, 0.3, 0.1, and below it may be anything."""

        def materials(self, points):
            random = np.random.default_rng(3)
            shown = points[:, 2] > -0.3
            albedo = np.where(shown[:, None], (0.6, 0.3, 0.1), random.uniform(0, 1, (len(points), 3)))
            alpha = np.where(shown, 0.25, random.uniform(0, 1, len(points)))
            return (
                np.float32(albedo),
                np.float32(alpha),
                np.full((len(points), 3), 0.04, np.float32),
            )

        def known(self, points, normals):
            return points[:, 2] > -0.2

    settings = AssetSettings(cells=64, triangles=4000, texture_size=128)
    light, silent = np.ones((4, 8, 3), np.float32), lambda fraction, text: None
    build_asset(Standing(((0.0, 0, 0), 0.6)), light, LEVEL, tmp_path, settings, silent, "cup", np.eye(4))
    pictures = [decode(tmp_path / name).pixels / 255 for name in ("albedo.png", "roughness.png")]
    albedo = srgb_to_linear(pictures[0])
    np.testing.assert_allclose(albedo, np.broadcast_to((0.6, 0.3, 0.1), albedo.shape), atol=0.01)
    np.testing.assert_allclose(pictures[1], 0.5, atol=0.01)


@pytest.mark.parametrize("angle, photos, known", [(0, 1, True), (75, 1, False), (75, 2, True)])
def test_one_photo_that_faces_a_place_tells_what_it_is_made_of_or_some_at_flat_angles(angle, photos, known):
    camera = cameras()[0]
    towards = camera.position / np.linalg.norm(camera.position)
    aside = np.cross(towards, (0.3, 0.5, 0.8))
    aside /= np.linalg.norm(aside)
    normal = np.cos(np.radians(angle)) * towards + np.sin(np.radians(angle)) * aside
    surface = SceneSurface(ball(radius=0.5, sharpness=400.0), [replace(camera)] * photos)
    assert surface.known(0.5 * towards[None], normal[None]) == [known]
