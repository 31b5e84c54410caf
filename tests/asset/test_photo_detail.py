"""Detail of photos in the albedo: a painted wall, looked at from many sides by pinhole cameras."""

import numpy as np
import pytest
import scipy.ndimage

from solver.asset.bake import SurfaceSamples
from solver.asset.photo_detail import Surface, View, are_finer, photo_detail, with_photo_detail
from solver.capture.camera import Camera

COUNT, SPACING, VOXEL = 180, 0.005, 0.02
RESPONSE, F0 = 0.5, 0.04
SIZE, FOCAL, DISTANCE = 240, 460.0, 2.0


def painted():
    """Blots [N, N, 3] of 0.1 to 0.9, as fine as the points of the wall allow, and of any colour."""
    noise = np.random.default_rng(0).normal(size=(COUNT, COUNT, 3))
    fine = scipy.ndimage.gaussian_filter(noise, (1.2, 1.2, 0))
    return 0.5 + 0.4 * np.tanh(fine / fine.std())


def blurred(pattern):
    """What a field of voxels that large makes of it."""
    sigma = VOXEL / SPACING
    return scipy.ndimage.gaussian_filter(pattern, (sigma, sigma, 0), mode="nearest")


def wall(f0=F0):
    ticks = (np.arange(COUNT) - (COUNT - 1) / 2) * SPACING
    x, y = np.meshgrid(ticks, ticks)
    points = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    normals = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    return Surface(points, normals, SPACING, VOXEL, np.full((len(points), 3), f0))


def camera(number):
    """On a circle above the wall, looking at its middle."""
    turn = 2.4 * number
    back = np.array([0.35 * np.cos(turn), 0.35 * np.sin(turn), 1.0])
    back /= np.linalg.norm(back)
    right = np.cross((0.0, 1.0, 0.0), back)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(back, right), back, DISTANCE * back], 1)
    return Camera(f"c{number}", None, pose, SIZE, SIZE, FOCAL, FOCAL, SIZE / 2, SIZE / 2)


def view(number, radiance, mirrored=0.0, gain=1.0, is_hdr=True):
    """A photo of the wall with radiance [N, N, 3], which mirrors so much besides."""
    one = camera(number)
    row, column = np.mgrid[:SIZE, :SIZE] + 0.5
    origins, directions = one.rays(column.ravel(), row.ravel())
    hit = origins - directions * (origins[:, 2] / directions[:, 2])[:, None]
    at = hit[:, 1::-1].T / SPACING + (COUNT - 1) / 2
    inside = ((at > -0.5) & (at < COUNT - 0.5)).all(0)
    colours = [
        scipy.ndimage.map_coordinates(channel, at, order=1, mode="nearest")
        for channel in np.moveaxis(radiance, -1, 0)
    ]
    colours = (np.stack(colours, 1) + mirrored) * gain
    if not is_hdr:
        colours = np.minimum(colours, 1)
    pixels = np.concatenate([colours * inside[:, None], inside[:, None]], axis=1)
    pixels = pixels.reshape(SIZE, SIZE, 4).astype(np.float32)
    return View(one, pixels, is_hdr, np.full(3, gain))


def found(views, pattern, surface=None):
    """The albedo [N, N, 3] that photos make of a blurred one, in the middle of the wall."""
    albedo = blurred(pattern).reshape(-1, 3).astype(np.float32)
    surface = surface or wall()
    nothing = np.zeros_like(albedo)
    samples = SurfaceSamples(albedo, nothing[:, 0], nothing, surface.normals)
    response = np.full_like(albedo, RESPONSE)
    told = []
    result = with_photo_detail(samples, surface, response, views, told.append)
    assert told == sorted(told) and told[-1] == 1
    return middle(result.albedo.reshape(COUNT, COUNT, 3))


def middle(picture):
    return picture[40:-40, 40:-40]


def rms(values):
    return float(np.sqrt((values**2).mean()))


@pytest.mark.parametrize("mirrored", [0.0, 0.2])
def test_the_albedo_gets_what_photos_show_sharper_whatever_is_mirrored(mirrored):
    pattern = painted()
    views = [view(i, RESPONSE * pattern, mirrored * (1 + i % 3)) for i in range(10)]
    before, after = middle(blurred(pattern) - pattern), found(views, pattern) - middle(pattern)
    assert rms(after) < 0.4 * rms(before)


def test_photos_that_are_brighter_than_others_show_the_same():
    pattern = painted()
    views = [view(i, RESPONSE * pattern) for i in range(8)]
    brighter = [view(i, RESPONSE * pattern, gain=1 + i / 4) for i in range(8)]
    np.testing.assert_allclose(found(brighter, pattern), found(views, pattern), atol=1e-3)


def test_what_photos_do_not_agree_on_is_left_out():
    pattern, random = painted(), np.random.default_rng(1)
    smooth = blurred(pattern)
    views = []
    for i in range(8):
        noise = scipy.ndimage.gaussian_filter(random.normal(size=smooth.shape), (1.2, 1.2, 0))
        views.append(view(i, RESPONSE * smooth + 0.1 * noise / noise.std()))
    assert rms(found(views, pattern) - middle(smooth)) < 0.1 * 0.1 / RESPONSE


def test_a_highlight_in_one_photo_does_not_come_into_the_albedo():
    pattern = painted()
    views = [view(i, RESPONSE * pattern) for i in range(8)]
    row, column = np.mgrid[:COUNT, :COUNT]
    glint = np.exp(-((row - 90) ** 2 + (column - 90) ** 2) / 18)[..., None]
    with_glint = [view(0, RESPONSE * pattern + glint), *views[1:]]
    assert np.abs(found(with_glint, pattern) - found(views, pattern)).max() < 0.1


def test_metal_and_what_one_photo_alone_shows_stay_as_they_are():
    pattern = painted()
    views = [view(i, RESPONSE * pattern) for i in range(8)]
    smooth = middle(blurred(pattern)).astype(np.float32)
    np.testing.assert_array_equal(found(views, pattern, wall(f0=0.9)), smooth)
    np.testing.assert_array_equal(found(views[:1], pattern), smooth)


def test_clipped_photos_do_not_make_the_albedo_darker():
    pattern = painted()
    views = [view(i, RESPONSE * pattern, mirrored=0.7, is_hdr=False) for i in range(8)]
    clipped = (views[0].pixels[..., :3] >= 1).any(-1).mean()
    assert 0.1 < clipped < 0.9
    assert abs((found(views, pattern) - middle(blurred(pattern))).mean()) < 0.01


def test_what_stands_before_the_wall_does_not_come_onto_it():
    """A black plate hides half of it from every camera."""
    pattern, plain = painted(), wall()
    hidden = plain.points[:, 0] > 0
    plate = plain.points[hidden] + (0.0, 0.0, 0.3)
    surface = Surface(
        np.concatenate([plain.points, plate]), np.tile([0.0, 0.0, 1.0], (len(plate) + len(hidden), 1)),
        SPACING, VOXEL, np.full((len(plate) + len(hidden), 3), F0),
    )  # fmt: skip
    black = np.zeros((COUNT, COUNT, 3))
    views = []
    for i in range(8):
        photo = view(i, RESPONSE * pattern)
        covered = view(i, black).pixels.copy()
        columns, rows = photo.camera.project(plate)[0].astype(int).T
        inside = (columns >= 0) & (columns < SIZE) & (rows >= 0) & (rows < SIZE)
        pixels = photo.pixels.copy()
        pixels[rows[inside], columns[inside], :3] = covered[rows[inside], columns[inside], :3]
        views.append(photo._replace(pixels=pixels))
    shown = np.concatenate([RESPONSE * blurred(pattern).reshape(-1, 3), np.zeros((len(plate), 3))])
    detail = photo_detail(surface, shown, views, lambda done: None)
    behind = hidden & (plain.points[:, 0] > 0.15) & (np.abs(plain.points[:, 1]) < 0.2)
    behind &= plain.points[:, 0] < 0.25
    assert np.abs(detail[: len(hidden)][behind]).max() < 1e-6
    beside = (plain.points[:, 0] < -0.1) & (np.abs(plain.points[:, 1]) < 0.2)
    assert rms(detail[: len(hidden)][beside]) > 0.05


def test_photos_far_finer_than_texels_are_not_dark_at_outlines():
    pattern = painted()
    even = np.full_like(pattern, 0.5)
    small = wall()
    few = Surface(small.points, small.normals, 4 * SPACING, VOXEL, small.f0)
    views = [view(i, RESPONSE * even) for i in range(8)]
    detail = photo_detail(few, np.full_like(small.points, 0.5 * RESPONSE), views, lambda done: None)
    assert np.abs(detail).max() < 1e-3


def test_only_photos_that_are_finer_than_voxels_have_any_detail():
    cameras = [camera(i) for i in range(5)]
    pixel = DISTANCE / FOCAL
    assert are_finer(cameras, np.zeros(3), 2 * pixel)
    assert not are_finer(cameras, np.zeros(3), pixel)
    assert not are_finer([], np.zeros(3), 1.0)
