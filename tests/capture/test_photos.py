"""Photos: every depth and every colour space, declared or not."""

import io
import struct

import numpy as np
import OpenEXR
import pytest
import tifffile
from PIL import Image, ImageCms

from solver.capture.errors import CaptureError
from solver.capture.photo_settings import PhotoSettings
from solver.capture.photos import (
    load_photo,
    read_exr,
    read_exr_channels,
    srgb_to_linear,
)
from solver.fit.errors import SettingsError
from solver.fit.presets import settings_for
from tests.capture.pictures import UPRIGHT, camera_for, load, ramp, write, write_exr, write_hdr
from tests.capture.test_phone_formats import P3_TO_REC709


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
    np.testing.assert_allclose(photo.pixels[..., :3], np.broadcast_to(expected, (6, 10, 3)), atol=1e-6)
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


def test_what_a_radiance_file_was_made_brighter_by_is_taken_back(tmp_path):
    plain = load(write_hdr(tmp_path / "a.hdr")).pixels[..., :3]
    brighter = load(write_hdr(tmp_path / "b.hdr", "EXPOSURE=4\n")).pixels[..., :3]
    np.testing.assert_array_equal(brighter, plain / 4)
    impossible = load(write_hdr(tmp_path / "c.hdr", "EXPOSURE=0\n")).pixels[..., :3]
    np.testing.assert_array_equal(impossible, plain)


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
    np.testing.assert_allclose(load(tmp_path / "a.png").pixels[..., :3], srgb_to_linear(shown), atol=1e-5)


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


def test_chromaticities_of_openexr_are_converted(tmp_path):
    colour = np.array([0.5, 0.4, 0.2], np.float32)
    pixels = np.broadcast_to(colour, (4, 4, 3)).copy()
    photo = load(write_exr(tmp_path / "a.exr", pixels, chromaticities=ACES_AP0))
    np.testing.assert_allclose(photo.pixels[0, 0, :3], REC709_FROM_AP0 @ colour, atol=1e-4)
    white = load(write_exr(tmp_path / "w.exr", np.ones((4, 4, 3), np.float32), chromaticities=ACES_AP0))
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
        with pytest.raises(CaptureError, match="b.exr, channels: it has no R, G and B, only ViewLayer"):
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
    """A profile of three XYZ columns (D50) and one curve for all channels; without columns, of greys."""
    tags = {b"wtpt": b"XYZ \0\0\0\0" + fixed((0.9642, 1, 0.8249))}
    tags[b"cprt"] = b"text\0\0\0\0none\0"
    tags[b"desc"] = b"desc\0\0\0\0" + struct.pack(">I", 2) + b"x\0" + bytes(79)
    for i, name in enumerate((b"r", b"g", b"b") if colorants is not None else ()):
        tags[name + b"XYZ"] = b"XYZ \0\0\0\0" + fixed(np.array(colorants)[:, i])
        tags[name + b"TRC"] = curve
    if colorants is None:
        tags[b"kTRC"] = curve
    table, body = b"", b""
    start = 128 + 4 + 12 * len(tags)
    for name, data in tags.items():
        data += bytes(-len(data) % 4)
        table += struct.pack(">4sII", name, start + len(body), len(data))
        body += data
    rest = struct.pack(">I", len(tags)) + table + body
    space = b"GRAY" if colorants is None else b"RGB "
    head = struct.pack(">I", 128 + len(rest)) + b"lcms\x02\x40\0\0mntr" + space + b"XYZ "
    head += bytes(12) + b"acsp"
    return head.ljust(68, b"\0") + fixed((0.9642, 1, 0.8249)) + bytes(48) + rest


DISPLAY_P3 = [
    [0.51512, 0.29198, 0.15710],
    [0.24120, 0.69225, 0.06657],
    [-0.00105, 0.04189, 0.78407],
]
REC709 = [[0.43607, 0.38515, 0.14307], [0.22249, 0.71687, 0.06061], [0.01392, 0.09708, 0.71410]]
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
@pytest.mark.parametrize("name", ["a.png", "a.tif", "a.webp", "a.avif"])
def test_an_icc_profile_is_followed_as_littlecms_follows_it(tmp_path, colorants, curve, name):
    profile = icc_profile(colorants, curve)
    # Colours well inside Rec. 709: LittleCMS clips the others.
    pixels = np.random.default_rng(1).integers(90, 160, (8, 8, 3)).astype(np.uint8)
    how = {"a.webp": {"lossless": True}, "a.avif": {"quality": 100, "subsampling": "4:4:4"}}
    Image.fromarray(pixels).save(tmp_path / name, icc_profile=profile, **how.get(name, {}))
    converted = ImageCms.profileToProfile(
        Image.fromarray(pixels), ImageCms.ImageCmsProfile(io.BytesIO(profile)),
        ImageCms.createProfile("sRGB"), renderingIntent=ImageCms.Intent.RELATIVE_COLORIMETRIC,
    )  # fmt: skip
    expected = srgb_to_linear(np.asarray(converted) / 255)
    lost = 0.016 if name == "a.avif" else 0.0  # two codes, to YCbCr and back
    np.testing.assert_allclose(load(tmp_path / name).pixels[..., :3], expected, atol=0.004 + lost)
    assert np.abs(srgb_to_linear(pixels / 255) - expected).max() > 0.01 + lost


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
@pytest.mark.parametrize("gamma", [1, 563 / 256])
def test_a_profiles_curve_holds_for_floating_point_and_goes_on_above_1(tmp_path, gamma, dtype):
    pixels = np.concatenate([ramp(dtype), 4 * ramp(dtype)])
    curve = GAMMA_CURVE[:-2] + struct.pack(">H", round(gamma * 256))
    profile = icc_profile(DISPLAY_P3, curve)
    tifffile.imwrite(tmp_path / "a.tif", pixels, photometric="rgb", iccprofile=profile)
    found = load(tmp_path / "a.tif")
    expected = (pixels.astype(float) ** gamma) @ np.transpose(P3_TO_REC709)
    assert found.is_hdr
    np.testing.assert_allclose(found.pixels[..., :3], expected, rtol=2e-3, atol=4e-3)


def test_a_linear_profile_leaves_floating_point_as_it_is(tmp_path):
    pixels = 9 * ramp(np.float32) - 1  # with some below 0
    profile = icc_profile(REC709, GAMMA_CURVE[:-2] + b"\1\0")
    tifffile.imwrite(tmp_path / "a.tif", pixels, photometric="rgb", iccprofile=profile)
    np.testing.assert_allclose(load(tmp_path / "a.tif").pixels[..., :3], pixels, rtol=1e-6)


def test_floating_point_with_a_profile_of_srgb_is_srgb(tmp_path):
    pixels = ramp(np.float32)
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    tifffile.imwrite(tmp_path / "a.tif", pixels, photometric="rgb", iccprofile=srgb)
    expected = srgb_to_linear(pixels)
    np.testing.assert_allclose(load(tmp_path / "a.tif").pixels[..., :3], expected, atol=1e-4)


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.tif"])
def test_a_profile_of_greys_is_followed(tmp_path, name):
    pixels = ramp(np.uint8, 1)[..., 0]
    profile = icc_profile(None, TABLE_CURVE)
    Image.fromarray(pixels).save(tmp_path / name, icc_profile=profile, quality=100)
    expected = np.repeat((pixels[..., None] / 255) ** 1.8, 3, axis=-1)
    lost = 0.02 if name == "a.jpg" else 1e-3
    np.testing.assert_allclose(load(tmp_path / name).pixels[..., :3], expected, atol=lost)


@pytest.mark.parametrize("kind", ["Lab", "16 bits of which 0 is white"])
def test_tiffs_of_colours_that_would_be_taken_for_others_are_refused(tmp_path, kind):
    if kind == "Lab":
        Image.fromarray(ramp(np.uint8)).convert("LAB").save(tmp_path / "a.tif")
    else:
        tifffile.imwrite(tmp_path / "a.tif", ramp(np.uint16, 1)[..., 0], photometric="miniswhite")
    with pytest.raises(CaptureError, match="a.tif: .*no photo has; export it as RGB"):
        load(tmp_path / "a.tif")


def test_a_tiff_of_8_bits_of_which_0_is_white_is_what_it_shows(tmp_path):
    pixels = ramp(np.uint8, 1)[..., 0]
    tifffile.imwrite(tmp_path / "a.tif", pixels, photometric="miniswhite")
    expected = srgb_to_linear(1 - pixels / 255)
    np.testing.assert_allclose(load(tmp_path / "a.tif").pixels[..., 0], expected, atol=1e-6)


def exif_of(interoperability, colour_space=0xFFFF):
    """EXIF as cameras write it of photos in Adobe RGB: the colour space and, in a directory below, a mark."""
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA001] = colour_space
    exif.get_ifd(0x8769)[0xA005] = {1: interoperability}
    return exif


def test_adobe_rgb_that_exif_alone_tells_of_is_that_of_the_profile(tmp_path):
    pixels = np.full((16, 16, 3), (120, 180, 110), np.uint8)
    marked, told, plain = tmp_path / "marked.jpg", tmp_path / "told.jpg", tmp_path / "plain.jpg"
    Image.fromarray(pixels).save(marked, quality=98, exif=exif_of("R03"))
    Image.fromarray(pixels).save(told, quality=98, icc_profile=icc_profile(ADOBE_RGB, GAMMA_CURVE))
    Image.fromarray(pixels).save(plain, quality=98)
    expected = load(told).pixels
    assert np.abs(expected - load(plain).pixels).max() > 0.1
    np.testing.assert_allclose(load(marked).pixels, expected, atol=2e-3)
    for exif in (exif_of("R98"), exif_of("R03", 1)):
        Image.fromarray(pixels).save(marked, quality=98, exif=exif)
        np.testing.assert_array_equal(load(marked).pixels, load(plain).pixels)
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    for profile in (srgb, icc_profile(DISPLAY_P3, SRGB_CURVE)):  # a profile goes before the mark
        Image.fromarray(pixels).save(marked, quality=98, exif=exif_of("R03"), icc_profile=profile)
        Image.fromarray(pixels).save(told, quality=98, icc_profile=profile)
        np.testing.assert_array_equal(load(marked).pixels, load(told).pixels)


def test_a_profile_of_srgb_or_a_damaged_one_changes_nothing(tmp_path):
    pixels = ramp(np.uint8)
    expected = load(write(tmp_path / "a.png", pixels)).pixels
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    for profile in (srgb, srgb[:200], icc_profile(np.zeros((3, 3)), SRGB_CURVE)):
        Image.fromarray(pixels).save(tmp_path / "b.png", icc_profile=profile)
        np.testing.assert_array_equal(load(tmp_path / "b.png").pixels, expected)


def test_a_profile_of_greys_without_end_changes_nothing(tmp_path):
    pixels = ramp(np.uint8, 1)
    expected = load(write(tmp_path / "a.png", pixels)).pixels
    profile = icc_profile(None, b"para" + bytes(8) + fixed([-1]))
    Image.fromarray(pixels[..., 0]).save(tmp_path / "b.png", icc_profile=profile)
    np.testing.assert_array_equal(load(tmp_path / "b.png").pixels, expected)
