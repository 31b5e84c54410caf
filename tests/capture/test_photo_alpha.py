"""What alpha, orientation tags and masks of photos mean."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from solver.capture.errors import CaptureError
from solver.capture.intake import Found, Intrinsics, assemble
from solver.capture.masks import resized_by_area
from solver.capture.photo_finder import PhotoFinder
from solver.capture.photos import (
    load_photo,
    read_image,
    srgb_to_linear,
)
from tests.capture.pictures import UPRIGHT, camera_for, load, ramp, write, write_exr


def test_alpha_of_png_and_tiff_is_straight_unless_tiff_says_it_is_associated(tmp_path):
    pixels = np.full((4, 4, 4), (200, 100, 50, 128), np.uint8)
    cover = 128 / 255
    straight = np.append(srgb_to_linear(np.array([200, 100, 50]) / 255) * cover, cover)
    Image.fromarray(pixels).save(tmp_path / "a.png")
    np.testing.assert_allclose(load(tmp_path / "a.png").pixels[0, 0], straight, atol=1e-6)
    file = write(tmp_path / "b.tif", pixels, oiio__UnassociatedAlpha=1)
    np.testing.assert_allclose(load(file).pixels[0, 0], straight, atol=1e-6)
    multiplied = np.full((4, 4, 4), (100, 50, 25, 128), np.uint8)
    photo = load(write(tmp_path / "c.tif", multiplied))
    undone = srgb_to_linear(np.array([100, 50, 25]) / 128)
    np.testing.assert_allclose(photo.pixels[0, 0], np.append(undone * cover, cover), atol=1e-6)
    assert photo.has_alpha


def test_alpha_of_floating_point_is_associated(tmp_path):
    pixels = np.full((4, 4, 4), (2.0, 0.5, 0.1, 0.25), np.float32)
    for file in (write_exr(tmp_path / "a.exr", pixels), write(tmp_path / "a.tif", pixels)):
        np.testing.assert_array_equal(load(file).pixels, pixels)
    straight = write(tmp_path / "b.tif", pixels, oiio__UnassociatedAlpha=1)
    np.testing.assert_allclose(load(straight).pixels[0, 0], (0.5, 0.125, 0.025, 0.25))


def tagged(path, orientation):
    """A file whose raw pixels are `UPRIGHT` turned so that the tag turns them back."""
    undo = {1: 1, 2: 2, 3: 3, 4: 4, 5: 5, 6: 8, 7: 7, 8: 6}[orientation]
    as_pillow = {
        1: None, 2: Image.Transpose.FLIP_LEFT_RIGHT, 3: Image.Transpose.ROTATE_180,
        4: Image.Transpose.FLIP_TOP_BOTTOM, 5: Image.Transpose.TRANSPOSE,
        6: Image.Transpose.ROTATE_270, 7: Image.Transpose.TRANSVERSE, 8: Image.Transpose.ROTATE_90,
    }  # fmt: skip
    picture = Image.fromarray(UPRIGHT)
    if undo != 1:
        picture = picture.transpose(as_pillow[undo])
    exif = Image.Exif()
    exif[0x0112] = orientation
    picture.save(path, exif=exif)
    return np.asarray(picture)


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("name", ["a.png", "a.tif"])
def test_a_photo_lies_as_its_camera_saw_it_whatever_its_orientation(tmp_path, name, orientation):
    raw = tagged(tmp_path / name, orientation)
    as_it_lies = load(tmp_path / name).pixels[..., 0]
    np.testing.assert_allclose(as_it_lies, srgb_to_linear(raw / 255), atol=1e-6)
    if orientation >= 5:
        upright = load_photo(camera_for(tmp_path / name, 4, 3)).pixels[..., 0]
        np.testing.assert_allclose(upright, srgb_to_linear(UPRIGHT / 255), atol=1e-6)
    np.testing.assert_allclose(read_image(tmp_path / name)[..., 0], UPRIGHT / 255, atol=1e-6)


def test_a_photo_without_a_tag_is_never_turned(tmp_path):
    Image.fromarray(UPRIGHT).save(tmp_path / "a.png")
    with pytest.raises(CaptureError, match="a.png: the photo is 4 × 3 pixels.*says 3 × 4"):
        load_photo(camera_for(tmp_path / "a.png", 3, 4))


@pytest.mark.parametrize("told", [(40, 30), (30, 40), (80, 60), (60, 80)])
def test_portrait_photos_get_intrinsics_for_the_size_their_camera_file_states(tmp_path, told):
    exif = Image.Exif()
    exif[0x0112] = 6  # 40 × 30 as it lies, 30 × 40 upright
    found = []
    for i in range(3):
        path = tmp_path / f"{i}.jpg"
        Image.new("RGB", (40, 30), "red").save(path, exif=exif)
        pose = np.eye(4)
        pose[2, 3] = i + 1
        found.append(Found("c", path.name, path, pose, Intrinsics(*told, 50.0, 60.0, 10.0, 20.0)))
    item = assemble(tmp_path / "cameras", "test", found, PhotoFinder(tmp_path)).cameras[0]
    share = 1 if 30 in told and 40 in told else 0.5
    assert (item.width, item.height) == (told[0] * share, told[1] * share)
    assert (item.fx, item.fy, item.cx, item.cy) == (50 * share, 60 * share, 10 * share, 20 * share)
    assert load_photo(item).pixels.shape == (item.height, item.width, 4)


HALF = np.zeros((8, 8), np.uint8)
HALF[:, 4:] = 255


def half_mask(kind):
    rgb = np.repeat(HALF[..., None], 3, axis=-1)
    white = np.full((8, 8, 3), 255, np.uint8)
    return {
        "grey": HALF[..., None],
        "grey of 16 bits": HALF[..., None].astype(np.uint16) * 257,
        "colour": rgb,
        "colour, all opaque": np.dstack([rgb, white[..., 0]]),
        "white with alpha": np.dstack([white, HALF]),
        "zeros and ones": (HALF // 255)[..., None],
        "smaller": rgb[::2, ::2].copy(),
        "larger": np.kron(HALF, np.ones((3, 3), np.uint8))[..., None],
    }[kind]


@pytest.mark.parametrize(
    "kind",
    ["grey", "grey of 16 bits", "colour", "colour, all opaque", "white with alpha", "zeros and ones",
     "smaller", "larger"],
)  # fmt: skip
def test_masks_of_every_kind_and_size_mean_the_same(tmp_path, kind):
    photo = write(tmp_path / "a.png", ramp(np.uint8, 3, (8, 8)))
    mask = write(tmp_path / "m.png", half_mask(kind), oiio__UnassociatedAlpha=1)
    masked, plain = load(photo, mask), load(photo)
    np.testing.assert_allclose(masked.pixels[..., 3], HALF / 255, atol=1e-6)
    np.testing.assert_allclose(masked.pixels, plain.pixels * (HALF / 255)[..., None], atol=1e-6)
    assert masked.has_alpha


def object_on(shades, kind):
    """A mask of a round object, drawn in one of the ways that programs have."""
    y, x = np.mgrid[:48, :64]
    inside = np.clip(16.5 - np.hypot(x - 30, y - 24), 0, 1)
    colour = np.uint8([[[200, 120, 40]]]) * shades[..., None] / 255
    drawn = {
        "grey": 128 * inside, "dark": 3 * np.round(inside), "red": [200, 0, 0] * inside[..., None],
        "cut out": np.dstack([colour, 255 * inside]), "cut out on white": np.dstack(
            [np.where(inside[..., None] > 0, colour, 255), 255 * inside]
        ),
    }[kind]  # fmt: skip
    return inside, Image.fromarray(np.round(drawn).astype(np.uint8))


@pytest.mark.parametrize("kind", ["grey", "dark", "red", "cut out", "cut out on white"])
def test_a_mask_shows_the_object_whole_however_it_is_drawn(tmp_path, kind):
    shades = np.random.default_rng(0).integers(40, 256, (48, 64))
    inside, picture = object_on(shades, kind)
    picture.save(tmp_path / "m.png")
    photo = write(tmp_path / "p.png", np.full((48, 64, 3), 90, np.uint8))
    alpha = load(photo, tmp_path / "m.png").pixels[..., 3]
    wanted = np.round(inside) if kind == "dark" else inside
    np.testing.assert_allclose(alpha, wanted, atol=0.02)


def test_a_black_and_white_mask_counts_where_alpha_only_leaves_corners_out(tmp_path):
    drawn = np.full((48, 64, 4), 255, np.uint8)
    drawn[..., :3] = 0
    drawn[10:30, 20:50, :3] = 255
    drawn[:3, :3, 3] = 0
    Image.fromarray(drawn).save(tmp_path / "m.png")
    photo = write(tmp_path / "p.png", np.full((48, 64, 3), 90, np.uint8))
    alpha = load(photo, tmp_path / "m.png").pixels[..., 3]
    np.testing.assert_allclose(alpha, drawn[..., 0] / 255, atol=1e-6)


@pytest.mark.parametrize("kind", ["dark all over", "noise", "a stray pixel"])
def test_a_mask_with_next_to_nothing_in_it_stays_empty(tmp_path, kind):
    drawn = np.zeros((48, 64), np.uint8)
    if kind == "dark all over":
        drawn[:] = 16
    elif kind == "noise":
        drawn[:] = np.random.default_rng(0).integers(0, 4, drawn.shape)
    else:
        drawn[5, 5] = 3
    Image.fromarray(drawn).save(tmp_path / "m.png")
    photo = write(tmp_path / "p.png", np.full((48, 64, 3), 90, np.uint8))
    assert load(photo, tmp_path / "m.png").pixels[..., 3].max() < 0.07


def test_a_mask_of_many_shades_is_as_bright_as_it_is(tmp_path):
    soft = np.linspace(0, 180, 48 * 64).reshape(48, 64).astype(np.uint8)
    Image.fromarray(soft).save(tmp_path / "m.png")
    photo = write(tmp_path / "p.png", np.full((48, 64, 3), 90, np.uint8))
    alpha = load(photo, tmp_path / "m.png").pixels[..., 3]
    np.testing.assert_allclose(alpha, soft / 255, atol=1e-6)


def test_a_mask_lies_as_its_photo_does(tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.new("RGB", (8, 4), "white").save(tmp_path / "a.png", exif=exif)
    mask = np.zeros((4, 8), np.uint8)
    mask[:, :2] = 255  # the left of the raw picture is the top of the upright one
    Image.fromarray(mask).save(tmp_path / "m.png")
    upright = load_photo(camera_for(tmp_path / "a.png", 4, 8, tmp_path / "m.png")).pixels[..., 3]
    np.testing.assert_array_equal(upright, mask.T / 255)
    raw = load_photo(camera_for(tmp_path / "a.png", 8, 4, tmp_path / "m.png")).pixels[..., 3]
    np.testing.assert_array_equal(raw, mask / 255)


def test_masks_limit_alpha_and_errors_name_them(tmp_path):
    pixels = np.full((8, 8, 4), 128, np.uint8)
    photo = write(tmp_path / "a.png", pixels, oiio__UnassociatedAlpha=1)
    mask = write(tmp_path / "m.png", HALF[..., None])
    limited = np.minimum(HALF, 128) / 255
    np.testing.assert_allclose(load(photo, mask).pixels[..., 3], limited, atol=1e-6)
    wide = write(tmp_path / "wide.png", np.zeros((8, 20, 1), np.uint8))
    with pytest.raises(CaptureError, match="wide.png.*20 × 8.*8 × 8"):
        load(photo, wide)
    with pytest.raises(CaptureError, match="none.png.*does not exist"):
        load(photo, tmp_path / "none.png")
    (tmp_path / "bad.png").write_bytes(mask.read_bytes()[:30])
    with pytest.raises(CaptureError, match="bad.png.*cannot be decoded"):
        load(photo, tmp_path / "bad.png")


@given(height=st.integers(1, 9), width=st.integers(1, 9), rows=st.integers(1, 9), columns=st.integers(1, 9))
def test_resizing_by_area_keeps_the_mean(height, width, rows, columns):
    image = np.random.default_rng(height * 10 + width).random((height, width))
    small = resized_by_area(image, columns, rows)
    assert small.shape == (rows, columns)
    np.testing.assert_allclose(small.mean(), image.mean(), atol=1e-6)


def test_a_mask_that_is_the_photos_own_alpha_changes_nothing(tmp_path):
    pixels = ramp(np.uint8, 4)
    pixels[..., 3] = np.linspace(0, 255, pixels[..., 3].size).reshape(pixels.shape[:2])
    photo = write(tmp_path / "a.png", pixels, oiio__UnassociatedAlpha=1)
    mask = write(tmp_path / "a_mask.png", np.ascontiguousarray(pixels[..., 3:]))
    np.testing.assert_allclose(load(photo, mask).pixels, load(photo).pixels, atol=1e-6)
