"""Photos and masks at a reduced size, turned as their cameras saw them."""

import tracemalloc

import numpy as np
import OpenEXR
import pytest
import tifffile
from PIL import Image

from solver.capture.colour import linear_to_srgb
from solver.capture.errors import CaptureError
from solver.capture.reduced import load_reduced, load_reduced_mask, read_header
from tests.capture.pictures import load, write, write_hdr
from tests.capture.test_photos import REC709, SRGB_CURVE, icc_profile


@pytest.mark.parametrize("upright", [False, True])
def test_a_mask_may_lie_as_the_photo_does_or_as_it_is_looked_at(upright, tmp_path):
    shown = np.zeros((30, 40), np.uint8)
    shown[:10, 20:] = 255
    turned = np.rot90(shown, -1)  # what EXIF's 6 makes of it
    Image.fromarray(turned if upright else shown).save(tmp_path / "mask.png")
    np.testing.assert_array_equal(load_reduced_mask(tmp_path / "mask.png", (40, 30), (30, 40), 6), turned)


def test_a_mask_of_another_shape_is_refused_also_where_photos_are_only_looked_at(tmp_path):
    file = tmp_path / "mask.png"
    Image.new("L", (400, 200)).save(file)
    assert load_reduced_mask(file, (50, 100), (800, 400)).shape == (50, 100)
    with pytest.raises(
        CaptureError, match="mask_path: the mask is 400 × 200 pixels, its photo 800 × 600; "
    ):
        load_reduced_mask(file, (75, 100), (800, 600))


def test_photos_are_reduced_upright_with_their_alpha(tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 6
    pixels = np.zeros((300, 400, 3), np.uint8)
    pixels[:, :100] = 255  # the left of the file is the top of the picture
    Image.fromarray(pixels).save(tmp_path / "a.jpg", exif=exif)
    colour, alpha = load_reduced(tmp_path / "a.jpg", 100)
    assert colour.shape == (100, 75, 3) and alpha is None
    assert colour[:20].min() > 200 and colour[30:].max() < 50
    header = read_header(tmp_path / "a.jpg")
    assert (header.width, header.height, header.focal) == (300, 400, None)
    Image.fromarray(np.full((8, 8), 40000, np.uint16)).save(tmp_path / "b.png")
    colour, _ = load_reduced(tmp_path / "b.png", 100)
    assert colour.shape == (8, 8, 3) and abs(int(colour[0, 0, 0]) - 40000 / 257) < 2


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_tiffs_are_reduced_by_means_as_other_photos_are(dtype, tmp_path):
    fine = np.indices((240, 320)).sum(axis=0) % 2 * np.iinfo(dtype).max
    write(tmp_path / "a.tif", np.repeat(fine[..., None], 4, axis=2).astype(dtype))
    colour, alpha = load_reduced(tmp_path / "a.tif", 80)
    assert colour.shape == (60, 80, 3) and alpha.shape == (60, 80)
    assert np.ptp(colour) <= 2 and abs(float(colour.mean()) - 127.5) < 2
    assert np.ptp(alpha) <= 2


def test_the_header_of_a_tiff_says_the_focal_length_and_lies_as_exif_has_it(tmp_path):
    pixels = np.zeros((30, 40, 3), np.uint16)
    write(tmp_path / "a.tif", pixels, Orientation=6, Exif__FocalLengthIn35mmFilm=26)
    header = read_header(tmp_path / "a.tif")
    assert (header.width, header.height, header.focal) == (30, 40, pytest.approx(26 / 36 * 40))
    write(tmp_path / "b.tif", pixels)
    header = read_header(tmp_path / "b.tif")
    assert (header.width, header.height, header.focal) == (40, 30, None)


def test_an_openexr_file_without_colours_is_refused_as_a_photo_and_read_as_a_mask(tmp_path):
    depth = np.ones((8, 8), np.float32)
    OpenEXR.File({}, {"Z": depth}).write(str(tmp_path / "a.exr"))
    for read in (load, lambda path: load_reduced(path, 8)):
        with pytest.raises(CaptureError, match="a.exr, channels: it has no R, G and B, only Z"):
            read(tmp_path / "a.exr")
    assert (load_reduced_mask(tmp_path / "a.exr", (8, 8), (8, 8)) == 255).all()
    OpenEXR.File({}, {"Y": depth}).write(str(tmp_path / "b.exr"))
    assert (load_reduced(tmp_path / "b.exr", 8)[0] == 255).all()


def test_linear_photos_are_reduced_where_they_are_and_by_means(tmp_path):
    """A fixed bug: of blocks of pixels the first was taken, so that all were moved by half a block."""
    rows, columns = np.mgrid[:360, :640] + 0.5
    blob = np.exp(-((columns - 300) ** 2 + (rows - 170) ** 2) / (2 * 40**2)).astype(np.float32)
    fine = (np.indices((360, 640)).sum(axis=0) % 2).astype(np.float32)
    noise = np.full((360, 640), np.nan, np.float32)
    OpenEXR.File({}, {"RGB": np.dstack([blob, fine, noise])}).write(str(tmp_path / "a.exr"))
    colour, alpha = load_reduced(tmp_path / "a.exr", 160)
    assert colour.shape == (90, 160, 3) and alpha is None
    small = colour[..., 0].astype(float)
    rows, columns = np.mgrid[:90, :160] + 0.5
    middle = [(small * at).sum() / small.sum() * 4 for at in (columns, rows)]
    np.testing.assert_allclose(middle, (300, 170), atol=0.2)
    # sRGB of half of the light.
    assert np.ptp(colour[..., 1]) <= 2 and abs(float(colour[..., 1].mean()) - 188) < 2
    assert (colour[..., 2] == 0).all()


@pytest.mark.parametrize("linear", [False, True])
def test_floating_point_with_a_profile_is_shown_as_the_profile_has_it(linear, tmp_path):
    codes = np.random.default_rng(0).random((6, 10, 3), np.float32)
    profile = icc_profile(REC709, b"curv" + bytes(8) if linear else SRGB_CURVE)
    tifffile.imwrite(tmp_path / "a.tif", codes, photometric="rgb", iccprofile=profile)
    expected = 255 * (linear_to_srgb(codes) if linear else codes)
    np.testing.assert_allclose(load_reduced(tmp_path / "a.tif", 10)[0], expected, atol=1)


def test_a_photo_of_16_bits_takes_no_more_memory_than_its_pixels(tmp_path):
    """A fixed bug: eight bytes a number, several times, of as many photos at once as there are cores."""
    pixels = np.random.default_rng(0).integers(0, 1 << 16, (1500, 2000, 3)).astype(np.uint16)
    write(tmp_path / "a.tif", pixels)
    load_reduced(tmp_path / "a.tif", 500)
    tracemalloc.start()
    load_reduced(tmp_path / "a.tif", 500)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2.5 * pixels.nbytes


def test_a_phones_200_megapixels_are_no_bomb(tmp_path):
    Image.new("1", (16320, 12240)).save(tmp_path / "a.png")
    header = read_header(tmp_path / "a.png")
    assert (header.width, header.height) == (16320, 12240)
    assert load_reduced(tmp_path / "a.png", 100)[0].shape == (75, 100, 3)


def test_a_radiance_file_is_looked_at_as_it_is_stored_however_bright_its_light(tmp_path):
    plain, _ = load_reduced(write_hdr(tmp_path / "a.hdr"), 10)
    for exposure in ("0.02", "50"):
        stored, _ = load_reduced(write_hdr(tmp_path / "b.hdr", f"EXPOSURE={exposure}\n"), 10)
        assert np.abs(stored.astype(int) - plain).max() <= 1
