"""The sample capture is what its README says, so that whatever is measured on it means something."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from solver.capture.photos import linear_to_srgb, load_photo, load_photos, read_exr
from solver.capture.read import read_capture

DUCK = Path(__file__).parents[2] / "samples" / "duck"
RELIT = ("sunset", "studio")


@pytest.fixture(scope="module")
def held_out():
    return read_capture(DUCK, "test")


def test_there_are_enough_photos_of_one_size_and_none_is_held_out_and_shown():
    train, test = read_capture(DUCK, "train"), read_capture(DUCK, "test")
    assert len(train.cameras) >= 48
    assert len(test.cameras) >= 12
    assert {(c.width, c.height) for c in (*train.cameras, *test.cameras)} == {(200, 200)}
    places = np.array([c.camera_to_world[:3, 3] for c in train.cameras])
    for camera in test.cameras:
        nearest = np.linalg.norm(places - camera.camera_to_world[:3, 3], axis=1).min()
        assert nearest > 0.05


def test_all_of_it_is_at_most_six_megabytes():
    assert sum(f.stat().st_size for f in DUCK.rglob("*") if f.is_file()) <= 6e6


def test_every_photo_shows_the_whole_duck_before_a_transparent_background():
    for photo in load_photos(read_capture(DUCK, "train")):
        alpha = photo.pixels[..., 3]
        assert 0.1 < (alpha > 0.5).mean() < 0.5
        edge = np.concatenate([alpha[0], alpha[-1], alpha[:, 0], alpha[:, -1]])
        assert edge.max() == 0


def test_true_normals_are_unit_vectors_that_face_the_camera_on_the_duck_alone(held_out):
    for camera in held_out.cameras:
        normal, _ = read_exr(camera.image_path.with_name(f"{camera.name}_normal.exr"))
        alpha = load_photo(camera).pixels[..., 3]
        length = np.linalg.norm(normal, axis=-1)
        np.testing.assert_allclose(length[alpha > 0.99], 1, atol=2e-3)
        assert (length[alpha == 0] == 0).mean() > 0.99
        row, column = np.nonzero(alpha > 0.99)
        _, direction = camera.rays(column + 0.5, row + 0.5)
        facing = -(normal[row, column] * direction).sum(-1)
        assert np.quantile(facing, 0.001) > -0.02


def test_true_radiance_is_the_photo_before_its_encoding(held_out):
    """Ties the files to one another, and sRGB and alpha to their conventions."""
    for camera in held_out.cameras[:4]:
        colour, alpha = read_exr(camera.image_path.with_name(f"{camera.name}_hdr.exr"))
        inside = alpha > 0.99
        encoded = np.asarray(Image.open(camera.image_path), np.float32)[..., :3] / 255
        expected = np.clip(linear_to_srgb(np.maximum(colour, 0)), 0, 1)
        assert np.abs(expected - encoded)[inside].max() < 0.012


def test_materials_vary_within_the_range_that_the_readme_states(held_out):
    rough, colours = [], []
    for camera in held_out.cameras:
        roughness, alpha = read_exr(camera.image_path.with_name(f"{camera.name}_roughness.exr"))
        albedo, _ = read_exr(camera.image_path.with_name(f"{camera.name}_albedo.exr"))
        rough.append(roughness[alpha > 0.99][:, 0])
        colours.append(albedo[alpha > 0.99])
    rough, colours = np.concatenate(rough), np.concatenate(colours)
    assert rough.min() < 0.1 and rough.max() == pytest.approx(0.35, abs=0.01)
    assert (colours.max(0) > 0.4).all() and (colours.min(0) < 0.05).all()


def test_lights_are_equirectangular_finite_and_of_the_stated_brightness():
    for path in (DUCK / "env.exr", *(DUCK / f"relight_{name}.exr" for name in RELIT)):
        radiance, _ = read_exr(path)
        assert radiance.shape == (256, 512, 3)
        assert np.isfinite(radiance).all() and (radiance >= 0).all()
        area = np.sin((np.arange(256) + 0.5) * np.pi / 256)
        luminance = (radiance @ np.float32([0.2126, 0.7152, 0.0722])).mean(1)
        assert (luminance * area).sum() / area.sum() == pytest.approx(0.7, rel=0.01)


@pytest.mark.parametrize("name", RELIT)
def test_relit_truth_shows_the_same_outline_under_another_light(name, held_out):
    files = sorted((DUCK / f"relight_{name}").glob("r_?.png"))
    assert len(files) >= 3
    cameras = {camera.name: camera for camera in held_out.cameras}
    for file in files:
        relit = np.asarray(Image.open(file), np.float32) / 255
        photo = np.asarray(Image.open(cameras[file.stem].image_path), np.float32) / 255
        assert np.abs(relit[..., 3] - photo[..., 3]).max() < 0.02
        inside = photo[..., 3] > 0.99
        assert np.abs(relit - photo)[inside].mean() > 0.02
