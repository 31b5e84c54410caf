"""Photos and masks: every depth, colour space, alpha and orientation, and files that are damaged."""

import io
import struct
import time
import tracemalloc
import zlib

import numpy as np
import OpenEXR
import OpenImageIO
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image, ImageCms

from solver.capture import frames
from solver.capture.camera import Camera
from solver.capture.errors import CaptureError
from solver.capture.image_header import image_size, may_have_alpha
from solver.capture.intake import Found, Intrinsics, assemble
from solver.capture.masks import resized_by_area
from solver.capture.photo_finder import PhotoFinder
from solver.capture.photo_settings import PhotoSettings
from solver.capture.photos import (
    load_photo,
    read_exr,
    read_exr_channels,
    read_image,
    srgb_to_linear,
)
from solver.fit.errors import SettingsError
from solver.fit.presets import settings_for

UPRIGHT = np.arange(12, dtype=np.uint8).reshape(3, 4) * 20  # 4 wide, 3 high


def camera_for(path, width, height, mask=None):
    return Camera(
        name="c", image_path=path, camera_to_world=frames.invert_pose(np.eye(4)), width=width,
        height=height, fx=50.0, fy=50.0, cx=width / 2, cy=height / 2, mask_path=mask,
    )  # fmt: skip


def write(path, pixels, **attributes):
    """Write [H, W, C] with OpenImageIO in the array's own type."""
    kind = {"float32": "float", "float16": "half"}.get(pixels.dtype.name, pixels.dtype.name)
    spec = OpenImageIO.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], kind)
    for name, value in attributes.items():
        spec.attribute(name.replace("__", ":"), value)
    file = OpenImageIO.ImageOutput.create(str(path))
    assert file.open(str(path), spec), file.geterror()
    assert file.write_image(pixels), file.geterror()
    file.close()
    return path


def load(path, mask=None, **changes):
    return load_photo(camera_for(path, *image_size(path), mask), PhotoSettings(**changes))


def ramp(dtype, channels=3, size=(6, 10)):
    top = 1 if np.dtype(dtype).kind == "f" else np.iinfo(dtype).max
    values = np.random.default_rng(0).uniform(0, top, (*size, channels))
    return (values if top == 1 else np.round(values)).astype(dtype)


@pytest.mark.parametrize(
    "name, dtype, channels",
    [
        ("a.png", np.uint8, 3), ("a.png", np.uint16, 3), ("a.png", np.uint8, 1),
        ("a.png", np.uint16, 1), ("a.tif", np.uint8, 3), ("a.TIFF", np.uint16, 3),
        ("a.tif", np.uint16, 1),
    ],
)  # fmt: skip
def test_whole_numbers_are_srgb(tmp_path, name, dtype, channels):
    pixels = ramp(dtype, channels)
    photo = load(write(tmp_path / name, pixels))
    expected = srgb_to_linear(pixels / np.iinfo(dtype).max)
    np.testing.assert_allclose(
        photo.pixels[..., :3], np.broadcast_to(expected, (6, 10, 3)), atol=1e-6
    )
    assert (photo.pixels[..., 3] == 1).all() and not photo.has_alpha and not photo.is_hdr
    assert photo.pixels.dtype == np.float32 and photo.pixels.base is None


@pytest.mark.parametrize(
    "name, dtype, tolerance",
    [
        ("a.tif", np.float32, 0), ("a.tiff", np.float16, 0), ("a.exr", np.float32, 0),
        ("a.EXR", np.float16, 0), ("a.hdr", np.float32, 0.02),
    ],
)  # fmt: skip
def test_floating_point_is_linear_and_not_clipped(tmp_path, name, dtype, tolerance):
    pixels = ramp(dtype) * np.array(7, dtype)
    photo = load(write(tmp_path / name, pixels))
    peak = pixels.max(axis=-1, keepdims=True)  # an HDR file has one exponent a pixel
    assert (np.abs(photo.pixels[..., :3] - pixels) <= tolerance * peak).all()
    assert photo.is_hdr and not photo.has_alpha


@pytest.mark.parametrize("name", ["a.png", "a.tif"])
def test_a_gradient_of_16_bits_keeps_its_steps(tmp_path, name):
    steps = np.arange(30_000, 30_200, dtype=np.uint16)
    pixels = np.broadcast_to(steps[None, :, None], (2, 200, 3)).copy()
    photo = load(write(tmp_path / name, pixels))
    assert len(np.unique(photo.pixels[0, :, 1])) == 200
    assert (np.diff(photo.pixels[0, :, 1]) > 0).all()


def test_jpeg_is_srgb(tmp_path):
    Image.new("RGB", (16, 8), (200, 100, 50)).save(tmp_path / "a.jpg", quality=95, subsampling=0)
    expected = srgb_to_linear(np.array([200, 100, 50]) / 255)
    np.testing.assert_allclose(load(tmp_path / "a.jpg").pixels[3, 3, :3], expected, atol=0.01)


@pytest.mark.parametrize("mode", ["P", "L", "1", "LA"])
def test_pictures_with_palettes_or_shades_load_as_what_they_show(tmp_path, mode):
    picture = Image.fromarray(np.repeat(UPRIGHT[..., None], 3, axis=-1)).convert(mode)
    picture.save(tmp_path / "a.png")
    shown = np.asarray(picture.convert("RGB")) / 255
    np.testing.assert_allclose(
        load(tmp_path / "a.png").pixels[..., :3], srgb_to_linear(shown), atol=1e-5
    )


def test_a_declared_colour_space_counts_more_than_the_files_kind(tmp_path):
    whole = write(tmp_path / "a.png", ramp(np.uint16))
    np.testing.assert_allclose(
        load(whole, colour_space="linear").pixels[..., :3], ramp(np.uint16) / 65535, atol=1e-6
    )
    real = write(tmp_path / "a.tif", ramp(np.float32))
    np.testing.assert_allclose(
        load(real, colour_space="srgb").pixels[..., :3], srgb_to_linear(ramp(np.float32)), atol=1e-6
    )


def test_the_colour_space_is_a_setting_and_a_wrong_one_is_refused():
    chosen = settings_for("draft", {"photos.colour_space": "linear"})
    assert chosen.photos == PhotoSettings("linear")
    with pytest.raises(SettingsError, match="photos.colour_space.*auto, srgb, linear"):
        settings_for("draft", {"photos.colour_space": "aces"})


ACES_AP0 = (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767)
# https://github.com/ampas/aces-dev: ACES2065-1 to linear Rec. 709 with Bradford's adaptation
REC709_FROM_AP0 = [
    [2.5216862, -1.1341310, -0.3875552],
    [-0.2764799, 1.3727191, -0.0962392],
    [-0.0153781, -0.1529753, 1.1683534],
]


def write_exr(path, pixels, **header):
    OpenEXR.File(header, {"RGBA" if pixels.shape[2] == 4 else "RGB": pixels}).write(str(path))
    return path


def test_chromaticities_of_openexr_are_converted(tmp_path):
    colour = np.array([0.5, 0.4, 0.2], np.float32)
    pixels = np.broadcast_to(colour, (4, 4, 3)).copy()
    photo = load(write_exr(tmp_path / "a.exr", pixels, chromaticities=ACES_AP0))
    np.testing.assert_allclose(photo.pixels[0, 0, :3], REC709_FROM_AP0 @ colour, atol=1e-4)
    white = load(
        write_exr(tmp_path / "w.exr", np.ones((4, 4, 3), np.float32), chromaticities=ACES_AP0)
    )
    np.testing.assert_allclose(white.pixels[..., :3], 1, atol=2e-4)


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.tif", "a.exr", "a.hdr"])
def test_a_photo_cut_in_half_is_refused_rather_than_half_read(tmp_path, name):
    kind = np.float32 if name in ("a.exr", "a.hdr") else np.uint8
    file = write(tmp_path / name, ramp(kind, 3, (90, 130)))
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with pytest.raises(CaptureError, match=f"{name}: the image cannot be (decoded|read)"):
        load_photo(camera_for(file, 130, 90))


def test_channels_of_openexr_are_told_by_name_in_whatever_order(tmp_path):
    names = {"Z": 9.0, "R": 1.0, "A": 0.5, "B": 0.25, "G": 0.75}
    channels = {name: np.full((4, 4), value, np.float32) for name, value in names.items()}
    OpenEXR.File({}, channels).write(str(tmp_path / "a.exr"))
    np.testing.assert_array_equal(load(tmp_path / "a.exr").pixels[0, 0], (1, 0.75, 0.25, 0.5))
    rgb, alpha = read_exr(tmp_path / "a.exr")
    assert rgb[0, 0].tolist() == [1, 0.75, 0.25] and alpha[0, 0] == 0.5
    channels = {"ViewLayer.Combined.R": channels["R"], "ViewLayer.Combined.A": channels["A"]}
    OpenEXR.File({}, channels).write(str(tmp_path / "b.exr"))
    assert read_exr_channels(tmp_path / "b.exr").shape == (4, 4, 1)
    for reading in (load, read_exr):
        with pytest.raises(
            CaptureError, match="b.exr, channels: it has no R, G and B but ViewLayer"
        ):
            reading(tmp_path / "b.exr")


def test_chromaticities_of_rec709_change_nothing_and_impossible_ones_are_named(tmp_path):
    pixels = ramp(np.float32)
    own = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
    photo = load(write_exr(tmp_path / "a.exr", pixels, chromaticities=own))
    assert (photo.pixels[..., :3] == pixels).all()
    write_exr(tmp_path / "b.exr", pixels, chromaticities=(0.3, 0.3) * 4)
    with pytest.raises(CaptureError, match="b.exr, chromaticities: "):
        load(tmp_path / "b.exr")


def fixed(values):
    return b"".join(struct.pack(">i", round(value * 65536)) for value in values)


def icc_profile(colorants, curve):
    """An RGB profile of three XYZ columns (D50) and one curve for all channels."""
    tags = {b"wtpt": b"XYZ \0\0\0\0" + fixed((0.9642, 1, 0.8249))}
    tags[b"cprt"] = b"text\0\0\0\0none\0"
    tags[b"desc"] = b"desc\0\0\0\0" + struct.pack(">I", 2) + b"x\0" + bytes(79)
    for i, name in enumerate((b"r", b"g", b"b")):
        tags[name + b"XYZ"] = b"XYZ \0\0\0\0" + fixed(np.array(colorants)[:, i])
        tags[name + b"TRC"] = curve
    table, body = b"", b""
    start = 128 + 4 + 12 * len(tags)
    for name, data in tags.items():
        data += bytes(-len(data) % 4)
        table += struct.pack(">4sII", name, start + len(body), len(data))
        body += data
    rest = struct.pack(">I", len(tags)) + table + body
    head = (
        struct.pack(">I", 128 + len(rest)) + b"lcms\x02\x40\0\0mntrRGB XYZ " + bytes(12) + b"acsp"
    )
    return head.ljust(68, b"\0") + fixed((0.9642, 1, 0.8249)) + bytes(48) + rest


DISPLAY_P3 = [
    [0.51512, 0.29198, 0.15710],
    [0.24120, 0.69225, 0.06657],
    [-0.00105, 0.04189, 0.78407],
]
ADOBE_RGB = [[0.60974, 0.20528, 0.14919], [0.31111, 0.62567, 0.06322], [0.01947, 0.06087, 0.74457]]
SRGB_CURVE = b"para\0\0\0\0\0\3\0\0" + fixed((2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045))
GAMMA_CURVE = b"curv\0\0\0\0\0\0\0\1" + struct.pack(">H", round(563 / 256 * 256))
TABLE_CURVE = b"curv" + struct.pack(">II", 0, 1024) + b"".join(
    struct.pack(">H", round(65535 * (i / 1023) ** 1.8)) for i in range(1024)
)  # fmt: skip


@pytest.mark.parametrize(
    "colorants, curve",
    [(DISPLAY_P3, SRGB_CURVE), (ADOBE_RGB, GAMMA_CURVE), (DISPLAY_P3, TABLE_CURVE)],
)
@pytest.mark.parametrize("name", ["a.png", "a.tif"])
def test_an_icc_profile_is_followed_as_littlecms_follows_it(tmp_path, colorants, curve, name):
    profile = icc_profile(colorants, curve)
    # Colours well inside Rec. 709: LittleCMS clips the others.
    pixels = np.random.default_rng(1).integers(90, 160, (8, 8, 3)).astype(np.uint8)
    Image.fromarray(pixels).save(tmp_path / name, icc_profile=profile)
    converted = ImageCms.profileToProfile(
        Image.fromarray(pixels), ImageCms.ImageCmsProfile(io.BytesIO(profile)),
        ImageCms.createProfile("sRGB"), renderingIntent=ImageCms.Intent.RELATIVE_COLORIMETRIC,
    )  # fmt: skip
    expected = srgb_to_linear(np.asarray(converted) / 255)
    np.testing.assert_allclose(load(tmp_path / name).pixels[..., :3], expected, atol=0.004)
    assert np.abs(srgb_to_linear(pixels / 255) - expected).max() > 0.01


def test_a_profile_of_srgb_or_a_damaged_one_changes_nothing(tmp_path):
    pixels = ramp(np.uint8)
    expected = load(write(tmp_path / "a.png", pixels)).pixels
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    for profile in (srgb, srgb[:200], icc_profile(np.zeros((3, 3)), SRGB_CURVE)):
        Image.fromarray(pixels).save(tmp_path / "b.png", icc_profile=profile)
        np.testing.assert_array_equal(load(tmp_path / "b.png").pixels, expected)


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


def test_masks_multiply_alpha_and_errors_name_them(tmp_path):
    pixels = np.full((8, 8, 4), 128, np.uint8)
    photo = write(tmp_path / "a.png", pixels, oiio__UnassociatedAlpha=1)
    mask = write(tmp_path / "m.png", HALF[..., None])
    np.testing.assert_allclose(load(photo, mask).pixels[..., 3], HALF / 255 * 128 / 255, atol=1e-6)
    wide = write(tmp_path / "wide.png", np.zeros((8, 20, 1), np.uint8))
    with pytest.raises(CaptureError, match="wide.png.*20 × 8.*8 × 8"):
        load(photo, wide)
    with pytest.raises(CaptureError, match="none.png.*does not exist"):
        load(photo, tmp_path / "none.png")
    (tmp_path / "bad.png").write_bytes(mask.read_bytes()[:30])
    with pytest.raises(CaptureError, match="bad.png.*cannot be decoded"):
        load(photo, tmp_path / "bad.png")


@given(
    height=st.integers(1, 9), width=st.integers(1, 9), rows=st.integers(1, 9), columns=st.integers(1, 9)
)  # fmt: skip
def test_resizing_by_area_keeps_the_mean(height, width, rows, columns):
    image = np.random.default_rng(height * 10 + width).random((height, width))
    small = resized_by_area(image, columns, rows)
    assert small.shape == (rows, columns)
    np.testing.assert_allclose(small.mean(), image.mean(), atol=1e-6)


def test_a_whole_photo_needs_little_more_memory_than_its_pixels(tmp_path):
    file = write(tmp_path / "a.png", ramp(np.uint16, 3, (1000, 1500)))
    load(file)
    tracemalloc.start()
    photo = load(file)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    raw = 1000 * 1500 * 3 * 2
    # Finiteness is checked on booleans, a byte a value.
    assert peak < 1.5 * photo.pixels.nbytes + raw


def png_chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def huge_png(width, height):
    head = png_chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    return (
        b"\x89PNG\r\n\x1a\n"
        + head
        + png_chunk(b"IDAT", zlib.compress(b"\0" * 99))
        + png_chunk(b"IEND", b"")
    )


HUGE = {
    "a.png": huge_png(1 << 16, 1 << 15),
    "b.png": huge_png(0, 5),
    "a.tif": b"II*\0\x08\0\0\0\2\0" + struct.pack("<HHII", 256, 4, 1, 1 << 30)
    + struct.pack("<HHII", 257, 4, 1, 9) + b"\0\0\0\0",
    "a.hdr": b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 99999 +X 99999\n",
    "a.exr": b"\x76\x2f\x31\x01\2\0\0\0dataWindow\0box2i\0\x10\0\0\0"
    + struct.pack("<4i", -(1 << 30), 0, 1 << 30, 9),
}  # fmt: skip


@pytest.mark.parametrize("name", HUGE)
def test_a_header_that_claims_a_huge_picture_costs_nothing(tmp_path, name):
    (tmp_path / name).write_bytes(HUGE[name])
    tracemalloc.start()
    start = time.monotonic()
    try:
        with pytest.raises(CaptureError, match="which no photo has"):
            load_photo(camera_for(tmp_path / name, 8, 8))
        assert time.monotonic() - start < 1
        assert tracemalloc.get_traced_memory()[1] < 1 << 20
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("big", [False, True])
def test_sizes_of_tiff_are_read_in_both_byte_orders_and_in_bigtiff(tmp_path, order, big):
    mark = b"II" if order == "<" else b"MM"
    if big:
        head = mark + struct.pack(order + "HHHQ", 43, 8, 0, 16) + struct.pack(order + "Q", 2)
        entries = struct.pack(order + "HHQQ", 256, 16, 1, 70000)
        entries += struct.pack(order + "HHQHHI", 257, 3, 1, 3000, 0, 0)
    else:
        head = mark + struct.pack(order + "HI", 42, 8) + struct.pack(order + "H", 2)
        entries = struct.pack(order + "HHII", 256, 4, 1, 70000)
        entries += struct.pack(order + "HHIHH", 257, 3, 1, 3000, 0)
    (tmp_path / "a.tif").write_bytes(head + entries)
    assert image_size(tmp_path / "a.tif") == (70000, 3000)


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.tif", "a.exr", "a.hdr"])
def test_sizes_in_headers_are_those_of_the_pixels(tmp_path, name):
    kind = np.float32 if name in ("a.exr", "a.hdr") else np.uint8
    write(tmp_path / name, ramp(kind, 3, (5, 11)))
    assert image_size(tmp_path / name) == (11, 5)


@pytest.mark.parametrize(
    "name, channels, may", [("a.png", 3, False), ("a.png", 4, True), ("a.png", 1, False),
                            ("a.jpg", 3, False), ("a.tif", 3, True)]
)  # fmt: skip
def test_a_header_says_whether_a_photo_may_have_alpha(tmp_path, name, channels, may):
    write(tmp_path / name, ramp(np.uint8, channels, (5, 11)))
    assert may_have_alpha(tmp_path / name) == may
    assert may_have_alpha(tmp_path / "missing.png")


@pytest.fixture(scope="module")
def intact(tmp_path_factory):
    folder = tmp_path_factory.mktemp("intact")
    files = {}
    for name in ("a.png", "a.jpg", "a.tif", "a.exr", "a.hdr"):
        kind = np.float32 if name in ("a.exr", "a.hdr") else np.uint8
        files[name] = write(folder / name, ramp(kind, 3, (9, 13))).read_bytes()
    return files


@settings(
    max_examples=150, deadline=5000, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    name=st.sampled_from(["a.png", "a.jpg", "a.tif", "a.exr", "a.hdr"]),
    keep=st.floats(0, 1), at=st.floats(0, 1), patch=st.binary(max_size=6),
)  # fmt: skip
def test_damaged_photos_end_in_a_photo_or_an_error_of_one_line(
    tmp_path, intact, name, keep, at, patch
):
    data = bytearray(intact[name][: round(keep * len(intact[name]))])
    start = int(at * min(len(data), 400))
    data[start : start + len(patch)] = patch
    (tmp_path / name).write_bytes(data)
    try:
        assert load_photo(camera_for(tmp_path / name, 13, 9)).pixels.shape == (9, 13, 4)
    except CaptureError as error:
        assert name in str(error) and "\n" not in str(error)


def test_other_files_are_no_photos(tmp_path):
    Image.new("RGB", (4, 4)).save(tmp_path / "a.gif")
    (tmp_path / "a.gif").rename(tmp_path / "a.png")
    with pytest.raises(CaptureError, match="no PNG, JPEG, TIFF, OpenEXR or Radiance HDR"):
        load_photo(camera_for(tmp_path / "a.png", 4, 4))
    (tmp_path / "b.png").mkdir()
    with pytest.raises(CaptureError, match="b.png: the image cannot be read"):
        image_size(tmp_path / "b.png")


def test_values_that_are_no_numbers_are_named(tmp_path):
    pixels = np.ones((4, 4, 3), np.float32)
    pixels[1, 1, 1] = np.nan
    with pytest.raises(CaptureError, match="a.exr: .*not numbers"):
        load(write_exr(tmp_path / "a.exr", pixels))
