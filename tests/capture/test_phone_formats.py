"""HEIC, AVIF and WebP photos, which phones and the web have: pixels, turns, alpha, colour, damage.

`data/heif/make.py` made the HEIC files.
"""

import shutil
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from solver.capture.colour import srgb_to_linear
from solver.capture.decoding import decode
from solver.capture.errors import CaptureError
from solver.capture.heif_header import read_heif_header
from solver.capture.image_header import image_orientation, image_size, may_have_alpha
from solver.capture.orientation import oriented
from solver.capture.photo_finder import PhotoFinder
from solver.capture.photos import load_photo
from solver.capture.reduced import load_reduced, read_header
from tests.capture.data.heif.make import ramp
from tests.capture.pictures import camera_for, check_photo_or_error, load

HEIC = Path(__file__).parent / "data" / "heif"
# https://www.w3.org/TR/css-color-4/#color-conversion-code, lin_P3_to_XYZ and XYZ_to_lin_sRGB
P3_TO_REC709 = [[1.2249, -0.2247, 0.0], [-0.0420, 1.0419, 0.0], [-0.0196, -0.0786, 1.0979]]
ONE_CODE = 3.0  # of 8 bits, to YCbCr and back


@pytest.mark.parametrize("name", ["plain.heic", "p3.heic", "alpha.heic", "grey.heic", "ten_bits.heic"])
def test_heic_is_decoded_to_the_codes_that_were_written(name):
    decoded = decode(HEIC / name)
    truth = ramp()[..., :1] if name == "grey.heic" else ramp()
    colour = decoded.pixels[..., : truth.shape[2]] / decoded.largest * 255
    np.testing.assert_allclose(colour, truth, atol=ONE_CODE)
    assert decoded.largest == (65535 if name == "ten_bits.heic" else 255)
    assert (decoded.alpha == 3) == (name == "alpha.heic") == may_have_alpha(HEIC / name)


def test_ten_bits_hold_more_than_eight():
    codes = decode(HEIC / "ten_bits.heic").pixels[..., 0]
    assert codes.min() == 0 and codes.max() == 65535
    assert (codes % 257 != 0).any(), "no value lies between two of 8 bits"


def test_alpha_of_heic_is_straight():
    photo = load(HEIC / "alpha.heic")
    np.testing.assert_allclose(photo.pixels[..., 3], 128 / 255, atol=0.01)
    np.testing.assert_allclose(photo.pixels[24, -1, 0], 128 / 255, atol=0.01)


def test_a_turned_heic_is_read_as_it_is_to_be_shown():
    path = HEIC / "turned.heic"
    upright = oriented(ramp(), 6)
    assert image_size(path) == (48, 80) and image_orientation(path) == 1
    np.testing.assert_allclose(decode(path).pixels, upright, atol=ONE_CODE)
    np.testing.assert_allclose(load_reduced(path, 80)[0], upright, atol=ONE_CODE)
    header = read_header(path)
    assert (header.width, header.height) == (48, 80)
    assert header.focal == pytest.approx(26 / 36 * 80)


def test_photos_are_read_by_what_is_in_them_whatever_they_are_called(tmp_path):
    shutil.copy(HEIC / "turned.heic", tmp_path / "a.jpg")
    Image.fromarray(ramp()).save(tmp_path / "b.heic", "PNG")
    for name, truth in (("a.jpg", oriented(ramp(), 6)), ("b.heic", ramp())):
        np.testing.assert_allclose(decode(tmp_path / name).pixels, truth, atol=ONE_CODE)
        np.testing.assert_allclose(load_reduced(tmp_path / name, 80)[0], truth, atol=ONE_CODE)
        header = read_header(tmp_path / name)
        assert (header.width, header.height) == truth.shape[1::-1]


def test_display_p3_without_a_profile_becomes_rec_709():
    plain, wide = load(HEIC / "plain.heic").pixels, load(HEIC / "p3.heic").pixels
    expected = plain[..., :3] @ np.transpose(P3_TO_REC709)
    np.testing.assert_allclose(wide[..., :3], expected, atol=2e-3)


def test_light_that_is_coded_for_hdr_screens_is_refused_with_the_way_out():
    with pytest.raises(CaptureError, match=r"pq.heic.*HDR screens \(PQ\).*convert the photos to JPEG"):
        load(HEIC / "pq.heic")


@pytest.mark.parametrize("orientation", range(1, 9))
def test_avif_is_turned_as_its_file_says(orientation, tmp_path):
    exif = Image.Exif()
    exif[0x0112] = orientation
    path = tmp_path / "a.avif"
    Image.fromarray(ramp()).save(path, exif=exif, quality=100, subsampling="4:4:4")
    upright = oriented(ramp(), orientation)
    assert image_size(path) == upright.shape[1::-1] and image_orientation(path) == 1
    with path.open("rb") as file:
        assert read_heif_header(file).turn == orientation
    np.testing.assert_allclose(decode(path).pixels, upright, atol=ONE_CODE)
    np.testing.assert_allclose(load_reduced(path, 80)[0], upright, atol=ONE_CODE)


@pytest.mark.parametrize("lossless", [True, False])
@pytest.mark.parametrize("alpha", [True, False])
@pytest.mark.parametrize("name", ["a.webp", "a.avif"])
def test_webp_and_avif_keep_straight_alpha_and_say_so_in_their_header(name, alpha, lossless, tmp_path):
    pixels = np.dstack([ramp(), np.full((48, 80), 128, np.uint8)])
    how = {"lossless": lossless}
    if name == "a.avif":
        how = {"quality": 100 if lossless else 80, "subsampling": "4:4:4" if lossless else "4:2:0"}
    Image.fromarray(pixels[..., : 4 if alpha else 3]).save(tmp_path / name, **how)
    assert image_size(tmp_path / name) == (80, 48)
    assert may_have_alpha(tmp_path / name) == alpha
    decoded = decode(tmp_path / name)
    assert (decoded.alpha == 3) == alpha and not decoded.associated
    difference = np.abs(decoded.pixels[..., :3].astype(float) - ramp())
    assert difference.max() <= ONE_CODE if lossless else difference.mean() < 6
    if alpha and lossless:
        photo = load(tmp_path / name)
        expected = srgb_to_linear(ramp() / 255) * 128 / 255
        np.testing.assert_allclose(photo.pixels[..., :3], expected, atol=0.02)


@pytest.mark.parametrize("name", ["a.webp", "a.png"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_picture_lies_as_its_file_has_it_and_says_its_orientation(orientation, name, tmp_path):
    exif = Image.Exif()
    exif[0x0112] = orientation
    exif.get_ifd(0x8769)[0xA405] = 26
    path = tmp_path / name
    Image.fromarray(ramp()).save(path, exif=exif, lossless=True)
    assert image_size(path) == (80, 48)
    decoded = decode(path)
    np.testing.assert_array_equal(decoded.pixels, ramp())
    assert image_orientation(path) == decoded.orientation == orientation
    upright = oriented(ramp(), orientation)
    np.testing.assert_array_equal(load_reduced(path, 80)[0], upright)
    header = read_header(path)
    assert (header.width, header.height) == upright.shape[1::-1]
    assert header.focal == pytest.approx(26 / 36 * 80)


@pytest.fixture(scope="module")
def intact(tmp_path_factory):
    folder = tmp_path_factory.mktemp("intact")
    picture = Image.fromarray(np.dstack([ramp(), ramp()[..., 0]]))
    picture.save(folder / "alpha.avif")
    picture.save(folder / "lossy.webp", exif=Image.Exif())
    picture.save(folder / "lossless.webp", lossless=True)
    picture.convert("RGB").save(folder / "plain.webp")
    for name in ("plain.heic", "turned.heic", "alpha.heic"):
        shutil.copy(HEIC / name, folder)
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@settings(max_examples=200, deadline=5000, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data(), keep=st.floats(0.3, 1), at=st.floats(0, 1), patch=st.binary(max_size=6))
def test_damaged_photos_end_in_a_photo_or_an_error_of_one_line(tmp_path, intact, data, keep, at, patch):
    name = data.draw(st.sampled_from(sorted(intact)))
    whole = bytearray(intact[name][: round(keep * len(intact[name]))])
    start = int(at * min(len(whole), 900))
    whole[start : start + len(patch)] = patch
    path = tmp_path / name
    path.write_bytes(whole)
    check_photo_or_error(path)


@pytest.mark.parametrize("name", ["plain.heic", "alpha.avif", "plain.webp", "lossless.webp"])
def test_a_header_that_was_cut_anywhere_is_told(name, intact, tmp_path):
    whole = intact[name]
    path = tmp_path / name
    path.write_bytes(whole)
    size = image_size(path)
    for length in range(0, min(len(whole), 600), 7):
        path.write_bytes(whole[:length])
        try:
            assert image_size(path) == size
        except CaptureError as error:
            assert name in str(error)
    path.write_bytes(whole[:20])
    with pytest.raises(CaptureError, match="cut off|damaged|this is no PNG"):
        image_size(path)


def test_of_a_heic_and_its_copy_in_one_folder_the_copy_counts(tmp_path):
    for index in range(3):
        shutil.copy(HEIC / "plain.heic", tmp_path / f"IMG_{index}.HEIC")
        if index:
            Image.fromarray(ramp()).save(tmp_path / f"IMG_{index}.jpg")
    finder = PhotoFinder(tmp_path)
    assert [path.name for path in finder.pictures()] == ["IMG_0.HEIC", "IMG_1.jpg", "IMG_2.jpg"]
    assert finder.find("IMG_1").name == "IMG_1.jpg" and finder.find("IMG_1.HEIC").name == "IMG_1.HEIC"


def test_a_copy_in_another_folder_is_what_cameras_were_solved_with(tmp_path):
    for folder in ("phone", "converted"):
        (tmp_path / folder).mkdir()
    shutil.copy(HEIC / "plain.heic", tmp_path / "phone" / "IMG_1.HEIC")
    Image.fromarray(ramp()).save(tmp_path / "converted" / "IMG_1.jpg")
    assert PhotoFinder(tmp_path).find("IMG_1") == tmp_path / "converted" / "IMG_1.jpg"


def box(kind, *contents):
    data = b"".join(contents)
    return struct.pack(">I4s", 8 + len(data), kind) + data


def phone_header(turns):
    """The header of a phone's photo: tiles of 512 × 512 (item 1), put together as item 49, and turned."""
    size = [box(b"ispe", struct.pack(">III", 0, *sides)) for sides in ((512, 512), (4032, 3024))]
    properties = box(b"ipco", *size, box(b"irot", bytes([turns])), box(b"auxC", b"\0" * 4 + b"depth\0"))
    items = struct.pack(">HBB", 1, 1, 1) + struct.pack(">HBBB", 49, 2, 0x80 | 2, 0x80 | 3)
    associations = box(b"ipma", struct.pack(">II", 0, 2), items)
    primary = box(b"pitm", struct.pack(">IH", 0, 49))
    meta = box(b"meta", b"\0" * 4, primary, box(b"iprp", properties, associations))
    return box(b"ftyp", b"heic\0\0\0\0mif1heic") + meta + box(b"mdat", b"tiles")


@pytest.mark.parametrize("turns, size", [(0, (4032, 3024)), (1, (3024, 4032)), (3, (3024, 4032))])
def test_the_size_of_a_photo_of_tiles_is_that_of_the_whole_as_it_is_shown(turns, size, tmp_path):
    path = tmp_path / "IMG_0001.HEIC"
    path.write_bytes(phone_header(turns))
    assert image_size(path) == size and not may_have_alpha(path)


def test_a_heic_header_that_claims_a_huge_picture_costs_nothing(tmp_path):
    path = tmp_path / "a.heic"
    head = phone_header(0).replace(struct.pack(">II", 4032, 3024), struct.pack(">II", 1 << 31, 9))
    path.write_bytes(head)
    with pytest.raises(CaptureError, match="which no photo has"):
        load_photo(camera_for(path, 8, 8))
    # A list of a length that the file does not have.
    path.write_bytes(head.replace(b"ipma\0\0\0\0\0\0\0\2", b"ipma\0\0\0\0\xff\xff\xff\xff"))
    with pytest.raises(CaptureError, match="which no photo has"):
        load_photo(camera_for(path, 8, 8))
