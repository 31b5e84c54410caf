"""Lens models: what comes out of a pixel goes back into it, and nothing lies beyond the fold."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solver.capture.lens_solve import WIDEST
from solver.capture.lenses import LENSES, distort, fold, is_usable, undistort


def numbers(*largest):
    return st.tuples(*(st.floats(-value, value) for value in largest))


DISTORTIONS = {
    "pinhole": st.just(()),
    "opencv": numbers(0.3, 0.2, 0.01, 0.01, 0.1),
    "brown": st.builds(
        lambda n, projection, higher: (*n, projection, *higher),
        numbers(0.3, 0.2, 0.01, 0.01, 0.1, 0.05, 0.01),
        st.sampled_from((0.0, 1.0, 2.0)),
        st.just(()) | numbers(1.0, 0.5),
    ),
    "opencv_fisheye": numbers(0.3, 0.2, 0.1, 0.1),
    "fov": numbers(3.1),
    "division": numbers(2.0),
    "eucm": st.tuples(st.floats(0, 1), st.floats(0.05, 5)),
    "visualsfm": numbers(1.0),
    "thin_prism_fisheye": numbers(0.2, 0.1, 0.01, 0.01, 0.05, 0.02, 0.01, 0.01),
    "fisheye_power": numbers(0.3, 0.2, 0.1, 0.05, 0.05),
    "equirectangular": st.just(()),
    "rad_tan_thin_prism_fisheye": numbers(*(0.2, 0.1, 0.1, 0.05, 0.02, 0.02), *(0.01,) * 6),
}
GRID = np.stack(np.meshgrid(*[np.linspace(-1.5, 1.5, 13)] * 2), -1).reshape(-1, 2).T


def test_every_lens_is_tried_here():
    assert DISTORTIONS.keys() == set(LENSES)


@pytest.mark.parametrize("lens", LENSES)
@settings(max_examples=80, deadline=None)
@given(data=st.data())
def test_the_direction_of_a_pixel_has_that_pixel(lens, data):
    distortion = data.draw(DISTORTIONS[lens])
    directions, met = undistort(lens, distortion, *GRID)
    assert np.isfinite(directions).all() and (np.abs(directions).max(axis=1) > 0).all()
    image = np.stack(distort(lens, distortion, directions[met]))
    seen = np.isfinite(image).all(axis=0)
    # At the fold itself rounding decides whether the direction is still seen.
    assert seen.all() or (~seen).sum() <= 8
    np.testing.assert_allclose(image[:, seen], GRID[:, met][:, seen], rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("lens", LENSES)
@settings(max_examples=80, deadline=None)
@given(data=st.data())
def test_the_pixel_of_a_direction_has_that_direction(lens, data):
    distortion = data.draw(DISTORTIONS[lens])
    angle = np.repeat(np.linspace(0, 1.2, 12), 8)
    turn = np.tile(np.arange(8) * 0.8, 12)
    directions = np.stack([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)], -1)
    x, y = distort(lens, distortion, directions)
    seen = np.isfinite(x)
    assert seen[:8].all()
    back, met = undistort(lens, distortion, x[seen], y[seen])
    back /= np.linalg.norm(back, axis=1, keepdims=True)
    # Near the fold the inverse is steep, so what is compared is the image of what comes back.
    again = np.stack(distort(lens, distortion, back[met]))
    np.testing.assert_allclose(again, np.stack([x[seen], y[seen]])[:, met], rtol=1e-6, atol=1e-8)
    middle = met & (angle[seen] < 0.3)
    assert met[angle[seen] < 0.3].all()
    np.testing.assert_allclose(back[middle], directions[seen][middle], atol=1e-5)


def test_a_pixel_is_found_where_newtons_steps_go_to_and_fro():
    lens, distortion = "opencv_fisheye", (0.0, 0.2, -0.046158262550215656, -0.009190839453145)
    radius = np.linspace(0, 1.875, 751)
    directions, met = undistort(lens, distortion, radius, 0 * radius)
    assert met.all()
    np.testing.assert_allclose(distort(lens, distortion, directions)[0], radius, atol=1e-9)


def test_a_pixel_beyond_the_widest_view_of_a_fov_lens_has_no_direction():
    omega = 0.9
    limit = np.arctan(WIDEST * 2 * np.tan(omega / 2)) / omega
    directions, met = undistort("fov", (omega,), np.array([1 - 1e-9, 1 + 1e-9]) * limit, np.zeros(2))
    assert met.tolist() == [True, False]
    assert np.isfinite(directions).all()


@pytest.mark.parametrize("last", [0.0, 1e-30, 1e-12, -1e-300])
def test_a_vanishing_coefficient_does_not_move_the_fold(last):
    angle = fold("opencv_fisheye", (0.0, 0.0, -0.0625, last))
    assert angle == pytest.approx((7 * 0.0625) ** (-1 / 6), rel=1e-6)


@pytest.mark.parametrize(
    "lens, distortion, widest",
    [
        ("eucm", (0.5, 1.0), np.pi),
        ("eucm", (0.0, 1.0), np.pi / 2),
        ("eucm", (1.0, 1.0), np.pi / 2),
        ("division", (-0.3,), np.pi),
        ("division", (0.25,), np.pi / 4),
        ("fov", (0.9,), np.pi / 2),
        ("visualsfm", (0.4,), np.pi / 2),
        ("brown", (0.0,) * 7 + (1.0,), np.pi),
        ("brown", (0.0,) * 7 + (2.0,), np.pi),
        ("thin_prism_fisheye", (0.0,) * 8, np.pi),
        ("rad_tan_thin_prism_fisheye", (0.0,) * 12, np.pi),
    ],
)
def test_a_lens_sees_as_far_as_its_formula_grows(lens, distortion, widest):
    angle = widest + np.array([-0.01, 0.01])
    x, _ = distort(lens, distortion, np.stack([np.sin(angle), 0 * angle, np.cos(angle)], -1))
    assert np.isfinite(x[0]) and x[0] > 0
    assert widest > 3 or np.isnan(x[1])


def test_numbers_that_make_no_lens_are_told_from_those_that_do():
    assert is_usable("fov", (0.9,)) and not is_usable("fov", (3.2,))
    assert is_usable("eucm", (0.6, 1.0)) and not is_usable("eucm", (1.1, 1.0))
    assert not is_usable("eucm", (0.6, 0.0)) and not is_usable("opencv", (1e30, 0.0))
