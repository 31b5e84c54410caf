"""The lens `brown`: its inverse, its fold, its round trip through a transforms file."""

import math

import numpy as np
import pytest

from solver.capture.brown_lens import polynomial_lens
from solver.capture.camera import Camera
from solver.capture.formats.transforms import write_transforms
from solver.capture.lenses import LENSES
from solver.capture.read import read_capture
from tests.capture.programs import names, poses, save_photos

DISTORTIONS = [
    (0.1, -0.05, 0.002, -0.001, 0.01, -0.02, 0.003, 0.0),
    (-0.08, 0.02, 0.002, -0.001, 0.01, -0.004, 0.0, 0.0),
    (-0.02, 0.004, 0.003, -0.002, 0.001, -0.0005, 0.002, 1.0),
    (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.01, 0.0),
    (0.1, -0.05, 0.002, -0.001, 0.01, -0.02, 0.003, 0.0, 0.8, -0.5),
    (-0.02, 0.004, 0.003, -0.002, 0.001, -0.0005, 0.0, 1.0, -0.6, 0.4),
    (0.06, 0.065, 0.0002, -0.0002, -0.024, 0.0, 0.002, 2.0),
    (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0),
]


def camera(distortion, **changes):
    values = dict(
        name="c", image_path=None, camera_to_world=np.eye(4), width=64, height=48, fx=50.0, fy=48.0,
        cx=30.0, cy=25.0, lens="brown", distortion=distortion,
    )  # fmt: skip
    return Camera(**{**values, **changes})


@pytest.mark.parametrize("distortion", DISTORTIONS)
def test_points_along_a_ray_project_to_its_pixel(distortion):
    item = camera(distortion)
    pixels = np.random.default_rng(0).uniform((0, 0), (64, 48), (200, 2))
    pixels[0] = item.cx, item.cy
    origins, directions = item.rays(pixels[:, 0], pixels[:, 1])
    projected, depth = item.project(origins + 2.5 * directions)
    np.testing.assert_allclose(projected, pixels, atol=1e-7)
    assert (depth > 0).all() and item.lens_reaches(pixels[:, 0], pixels[:, 1]).all()
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)


def test_without_its_own_terms_it_is_opencvs_lens():
    pixels = np.random.default_rng(0).uniform((0, 0), (64, 48), (50, 2))
    for lens, numbers, own in (
        ("opencv", (0.1, -0.05, 0.002, -0.001, 0.01), (0.1, -0.05, 0.002, -0.001, 0.01, 0, 0, 0)),
        ("opencv_fisheye", (0.05, -0.01, 0.002, 0.001), (0.05, -0.01, 0, 0, 0.002, 0.001, 0, 1)),
    ):
        a, b = camera(numbers, lens=lens).rays(*pixels.T), camera(own).rays(*pixels.T)
        np.testing.assert_allclose(a[1], b[1], atol=1e-9)


def test_beyond_the_fold_of_its_polynomial_a_lens_sees_nothing():
    # x (1 − x⁸ / 9) grows up to x = 1 and falls beyond.
    item = camera((0, 0, 0, 0, 0, -1 / 9, 0, 0))
    inside, _ = item.project(np.array([[0.9, 0, -1]]))
    beyond, _ = item.project(np.array([[1.2, 0, -1]]))
    behind, _ = item.project(np.array([[0.1, 0, 1]]))
    assert np.isfinite(inside).all() and np.isnan(beyond).all() and np.isnan(behind).all()
    column, row = item.cx + item.fx * np.array([0.85, 0.95]), np.full(2, item.cy)
    assert item.lens_reaches(column, row).tolist() == [True, False]
    _, directions = item.rays(column, row)
    np.testing.assert_allclose(directions[1], np.array([1, 0, -1]) / math.sqrt(2), atol=1e-3)


def test_a_fisheye_sees_behind_itself():
    item = camera((0, 0, 0, 0, 0, 0, 0, 1.0))
    angle = 1.9
    pixel, depth = item.project(np.array([[math.sin(angle), 0, -math.cos(angle)], [0, 0, -1.0]]))
    np.testing.assert_allclose(pixel, [(item.cx + item.fx * angle, item.cy), (item.cx, item.cy)])
    assert depth[0] < 0


def test_an_equisolid_fisheyes_image_grows_as_the_sine_of_half_the_angle():
    item = camera((0.1, -0.02, 0, 0, 0, 0, 0, 2.0))
    for angle in (0.0, 0.3, 1.2, math.pi / 2, 2.4):
        r = 2 * math.sin(angle / 2)
        radius = r * (1 + 0.1 * r**2 - 0.02 * r**4)
        for turn in (0.0, 2.0, 4.0):
            across, down = math.cos(turn), math.sin(turn)
            direction = [math.sin(angle) * across, -math.sin(angle) * down, -math.cos(angle)]
            pixel, _ = item.project(np.array([direction]))
            wanted = item.cx + item.fx * radius * across, item.cy + item.fy * radius * down
            np.testing.assert_allclose(pixel, [wanted], atol=1e-9)


def test_an_equisolid_fisheye_is_that_of_another_program():
    # PlaCamera, test_frame_camera.cpp, "MatchesMetashapeProjectionFamilies"
    item = camera((0.0,) * 7 + (2.0,), width=800, height=600, fx=400.0, fy=400.0, cx=407.5, cy=295.75)
    pixel, _ = item.project(np.array([[0.25, 0.1, -1.0]]))
    np.testing.assert_allclose(pixel, [(504.9019766555284, 256.78920933778863)], atol=1e-11)


def test_an_equisolid_fisheyes_pixels_are_of_equal_solid_angles():
    item = camera((0.0,) * 7 + (2.0,), fx=30.0, fy=30.0, cx=32.0, cy=24.0)
    pixels = np.array([[32.5, 24.5], [50, 20], [10, 40], [60, 45]])
    step = 1e-4

    def ray(across, down):
        return item.rays(pixels[:, 0] + across, pixels[:, 1] + down)[1]

    by_column = (ray(step, 0) - ray(-step, 0)) / (2 * step)
    by_row = (ray(0, step) - ray(0, -step)) / (2 * step)
    solid_angles = np.linalg.norm(np.cross(by_column, by_row), axis=1)
    np.testing.assert_allclose(solid_angles, 1 / 30.0**2, rtol=1e-6)


def test_an_equisolid_fisheye_sees_all_but_what_is_straight_behind_it():
    item = camera((0.0,) * 7 + (2.0,))
    column = item.cx + item.fx * np.array([1.999, 2.001])
    assert item.lens_reaches(column, np.full(2, item.cy)).tolist() == [True, False]
    _, directions = item.rays(column, np.full(2, item.cy))
    np.testing.assert_allclose(directions[1], [0, 0, 1], atol=1e-9)
    behind, _ = item.project(np.array([[0, 0, 1.0]]))
    assert np.isnan(behind).all()


def test_the_plainest_lens_is_chosen():
    assert polynomial_lens(()) == ("pinhole", ())
    assert polynomial_lens((0.1,)) == ("opencv", (0.1, 0, 0, 0, 0))
    assert polynomial_lens((0, 0), (0, 0.1)) == ("opencv", (0, 0, 0, 0.1, 0))
    assert polynomial_lens((1, 2, 3, 4), equidistant=True) == ("opencv_fisheye", (1, 2, 3, 4))
    assert polynomial_lens((1, 2, 3, 4)) == ("brown", (1, 2, 0, 0, 3, 4, 0, 0))
    assert polynomial_lens((0,), skew=0.1)[0] == "brown"
    assert polynomial_lens((0.1,), (0, 0, 0.5, 0.5)) == ("opencv", (0.1, 0, 0, 0, 0))
    assert polynomial_lens((0,), (0, 1, 2, 3)) == ("brown", (0, 0, 0, 1, 0, 0, 0, 0, 2, 3))
    assert polynomial_lens((0,), (0.1, 0), equidistant=True)[1][7] == 1
    assert polynomial_lens((), equisolid=True) == ("brown", (0, 0, 0, 0, 0, 0, 0, 2))
    assert {polynomial_lens((0, 0, 0, k))[0] for k in (0, 1)} <= set(LENSES)


@pytest.mark.parametrize("distortion", DISTORTIONS)
def test_transforms_round_trip(tmp_path, distortion):
    save_photos(tmp_path / "photos", size=(64, 48))
    written = [
        camera(distortion, name=name, image_path=tmp_path / "photos" / f"{name}.png", camera_to_world=pose)
        for name, pose in zip(names(), poses(), strict=True)
    ]
    write_transforms(tmp_path / "job" / "transforms_train.json", written)
    for a, b in zip(written, read_capture(tmp_path / "job", trusted=True).cameras, strict=True):
        assert (a.lens, a.distortion, a.fx, a.cx, a.name) == (
            b.lens,
            b.distortion,
            b.fx,
            b.cx,
            b.name,
        )
