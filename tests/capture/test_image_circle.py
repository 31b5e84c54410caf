"""The circle that a fisheye's image fills is told from black around it, and from nothing else."""

import numpy as np
import pytest
from PIL import Image

from solver.capture.camera import Camera
from solver.capture.capture import Capture
from solver.capture.image_circle import Circles, image_circle, sees_sideways
from solver.capture.panoramic_lens import EQUIRECTANGULAR, of_whole_sphere
from solver.capture.photos import load_photos
from tests.capture.test_capture import pose

WIDTH, HEIGHT = 96, 64
MIDDLE = (47.0, 33.0)


def camera(lens="opencv_fisheye", distortion=(0.0,) * 4, path=None, name="c", focal=20.0):
    return Camera(name, path, pose(0.4), WIDTH, HEIGHT, focal, focal, *MIDDLE, lens, tuple(distortion))


def radii():
    row, column = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    return np.hypot(column - MIDDLE[0], row - MIDDLE[1])


def disc(radius, seed=0, level=0.2):
    """A photo [H, W, 3] of some grey within a circle."""
    grey = np.random.default_rng(seed).uniform(0.05, 1.0, (HEIGHT, WIDTH, 1)) * level
    return np.where(radii()[..., None] < radius, grey, 0.0).repeat(3, -1)


@pytest.mark.parametrize(
    "lens, distortion, sideways",
    [
        ("pinhole", (), False), ("opencv", (-0.1, 0.01, 0.0, 0.0), False),
        ("opencv_fisheye", (0.01, 0.0, 0.0, 0.0), True), ("eucm", (0.6, 1.0), True),
        ("division", (-0.3,), True), (EQUIRECTANGULAR, (), False),
    ],
)  # fmt: skip
def test_fisheyes_see_at_a_right_angle_to_their_axis_and_perspectives_do_not(lens, distortion, sideways):
    item = camera(lens, distortion)
    if lens == EQUIRECTANGULAR:
        item = Camera("c", None, pose(0.4), WIDTH, HEIGHT, *of_whole_sphere(WIDTH, HEIGHT), EQUIRECTANGULAR)
    assert sees_sideways(item) == sideways


@pytest.mark.parametrize("radius", [24, 30, 45])
def test_of_a_circle_nearly_all_counts_and_nothing_beyond(radius):
    told = image_circle(camera(), disc(radius).max(-1))
    assert not told[radii() >= radius].any()
    assert told[radii() < 0.94 * radius].all()


def test_glare_beyond_and_darkness_within_do_not_matter():
    level = disc(30).max(-1)
    level[3, 5] = level[60, 90] = 0.5
    level[30:33, 40:44] = 0.0
    told = image_circle(camera(), level)
    assert told[radii() < 28].all() and not told[radii() >= 30].any()


def test_an_object_before_black_is_no_circle():
    assert image_circle(camera(), disc(15).max(-1)) is None, "too small"
    box = np.zeros((HEIGHT, WIDTH))
    box[4:60, 16:80] = 0.3
    assert image_circle(camera(), box) is None, "not round"
    beside = np.roll(disc(28).max(-1), 15, axis=1)
    assert image_circle(camera(), beside) is None, "not in the middle"
    assert image_circle(camera(), np.full((HEIGHT, WIDTH), 0.3)) is None
    assert image_circle(camera(), np.zeros((HEIGHT, WIDTH))) is None


def test_all_photos_of_a_lens_tell_and_each_lens_its_own():
    circles, other = Circles(), camera(focal=25.0)
    night = disc(30, 1)
    night[:, :50] = 0.0
    circles.add(camera(), night)
    assert circles.found() == {}, "half of it is dark in one photo"
    circles.add(camera(), disc(30, 2))
    circles.add(other, disc(44, 3))
    circles.add(camera("pinhole", ()), disc(30))
    found = circles.found()
    assert set(found) == {camera().lens_key, other.lens_key}
    assert found[camera().lens_key].sum() < found[other.lens_key].sum()


def capture_of(folder, lens, alpha=None):
    cameras = []
    for index in range(3):
        path = folder / f"{index}.png"
        colour = (255 * disc(30, index, 1.0)).astype(np.uint8)
        if alpha is not None:
            colour = np.concatenate([colour, alpha], axis=-1)
        Image.fromarray(colour).save(path)
        cameras.append(camera(lens, (0.0,) * 4, path, f"c{index}"))
    return Capture(str(folder), tuple(cameras), np.array([[-1.0] * 3, [1.0] * 3]))


def test_photos_of_a_fisheye_say_nothing_beyond_its_circle(tmp_path):
    for photo in load_photos(capture_of(tmp_path, "opencv_fisheye")):
        assert not photo.told[radii() >= 30].any() and photo.told[radii() < 28].all()
    small = load_photos(capture_of(tmp_path, "opencv_fisheye"), most_pixels=WIDTH * HEIGHT // 4)
    assert all(photo.told.shape == (HEIGHT // 2, WIDTH // 2) for photo in small)
    assert all(photo.told is None for photo in load_photos(capture_of(tmp_path, "opencv")))


def test_where_alpha_tells_the_object_black_around_it_is_its_background(tmp_path):
    alpha = np.where(radii() < 30, 255, 0).astype(np.uint8)[..., None]
    photos = load_photos(capture_of(tmp_path, "opencv_fisheye", alpha))
    assert all(photo.told is None for photo in photos)
