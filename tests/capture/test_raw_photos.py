"""Camera raw photos: colours, saturation, turns, borders, what is found of them, damage."""

import shutil
import struct
import time
import tracemalloc

import numpy as np
import pytest
import rawpy
import tifffile
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from solver.capture import image_header
from solver.capture.colour import linear_to_srgb
from solver.capture.decoding import decode
from solver.capture.errors import CaptureError
from solver.capture.image_header import image_orientation, image_size, is_raw, may_have_alpha
from solver.capture.orientation import oriented
from solver.capture.photo_finder import PhotoFinder
from solver.capture.photos import load_photo, load_photos
from solver.capture.raw_header import raw_exif, raw_orientation
from solver.capture.read import read_capture
from solver.capture.reduced import load_reduced, read_header
from tests.capture.data.heif.make import ramp
from tests.capture.pictures import camera_for, check_photo_or_error, load, write
from tests.capture.raw_photos import mosaic, patches, sensor_codes, write_dng

COLOURS = [[.2, .4, .6], [.6, .3, .1], [.05, .05, .05], [.9, .9, .9],
           [.02, .3, .5], [.7, .1, .1], [.3, .3, .3], [.01, .01, .01]]  # fmt: skip
SIDE = 32
ONE_CODE = 1 / 4000 / 0.5  # of the sensor, in the channel that is made brightest


def middles(pixels, side=SIDE):
    """The colour in the middle of each of `patches`."""
    return pixels[side // 2 :: side, side // 2 :: side, :3].reshape(-1, 3)


@pytest.mark.parametrize("demosaiced", [False, True], ids=["mosaic", "colours"])
def test_linear_colours_come_back_as_they_fell_on_the_sensor(demosaiced, tmp_path):
    path = write_dng(tmp_path / "a.dng", patches(COLOURS), demosaiced=demosaiced)
    photo = load(path)
    assert photo.pixels.dtype == np.float32 and not photo.has_alpha and not photo.is_hdr
    np.testing.assert_allclose(middles(photo.pixels), COLOURS, atol=2 * ONE_CODE)


@pytest.mark.parametrize("demosaiced", [False, True], ids=["mosaic", "colours"])
def test_a_saturated_sensor_is_1_in_all_channels_and_counts_as_clipped(demosaiced, tmp_path):
    colours = [[1, 1, 1], [1.5, 1.5, 1.5], [5, 5, 5], [5, 0.1, 0.1]]
    photo = load(write_dng(tmp_path / "a.dng", patches(colours), demosaiced=demosaiced))
    found = middles(photo.pixels)
    np.testing.assert_allclose(found[:3], 1, atol=1e-4)
    assert photo.pixels[..., :3].max() <= 1 and not photo.is_hdr
    # Red, of which the sensor takes the least, goes on to twice what is white here, and is cut there.
    np.testing.assert_allclose(found[3], [1, 0.1, 0.1], atol=2 * ONE_CODE)


def test_photos_are_not_made_brighter_by_what_they_show_or_say(tmp_path):
    plain = load(write_dng(tmp_path / "a.dng", patches(COLOURS))).pixels
    dim = load(write_dng(tmp_path / "b.dng", patches(COLOURS) * 0.85)).pixels
    told = load(write_dng(tmp_path / "c.dng", patches(COLOURS), brighter=1.5)).pixels
    np.testing.assert_allclose(middles(dim), np.array(COLOURS) * 0.85, atol=2 * ONE_CODE)
    np.testing.assert_array_equal(told, plain)


def test_a_photo_without_a_white_balance_is_not_balanced_by_its_own_colours(tmp_path):
    red = patches([[0.4, 0.1, 0.1]] * 4)
    found = middles(load(write_dng(tmp_path / "a.dng", red, neutral=None)).pixels)
    sensor = np.array([0.4, 0.1, 0.1]) * (0.5, 1.0, 0.7)
    np.testing.assert_allclose(found, np.tile(sensor, (4, 1)), atol=2e-3)


def test_another_white_balance_changes_the_colours_of_white_to_white(tmp_path):
    grey = patches([[0.3, 0.3, 0.3]] * 4)
    for number, neutral in enumerate([(0.5, 1, 0.7), (0.9, 1, 0.4)]):
        path = write_dng(tmp_path / f"{number}.dng", grey, neutral=neutral)
        np.testing.assert_allclose(middles(load(path).pixels), 0.3, atol=2e-3)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_raw_photos_lie_as_their_sensor_does_and_say_their_orientation(orientation, tmp_path):
    path = write_dng(tmp_path / "a.dng", patches(COLOURS), orientation=orientation)
    assert image_size(path) == (128, 64)
    decoded = decode(path)
    assert decoded.pixels.shape == (64, 128, 3)
    assert image_orientation(path) == decoded.orientation == orientation
    upright = oriented(patches(COLOURS), orientation)
    assert np.abs(load_reduced(path, 128)[0] - 255 * linear_to_srgb(upright)).mean() < 3
    header = read_header(path)
    assert (header.width, header.height) == upright.shape[1::-1]


def test_a_raw_photo_is_turned_only_if_its_camera_has_the_turned_size(tmp_path):
    path = write_dng(tmp_path / "a.dng", patches(COLOURS), orientation=6)
    lying = load_photo(camera_for(path, 128, 64)).pixels
    upright = load_photo(camera_for(path, 64, 128)).pixels
    np.testing.assert_array_equal(upright, oriented(lying, 6))
    with pytest.raises(CaptureError, match="a.dng: the photo is 128 × 64 pixels, but its camera"):
        load_photo(camera_for(path, 100, 64))


@pytest.mark.parametrize("least", [0, 40], ids=["whole", "half"])
@pytest.mark.parametrize("crop", [(6, 4, 100, 50), (5, 3, 98, 50)], ids=["even", "odd"])
def test_the_picture_is_what_the_camera_calls_so_without_the_sensors_border(crop, least, tmp_path):
    linear = np.zeros((64, 128, 3))
    left, top, width, height = 2 + crop[0], 2 + crop[1], *crop[2:]
    linear[top : top + height, left : left + width] = 0.5
    path = write_dng(tmp_path / "a.dng", linear, active=(2, 2, 62, 126), crop=crop)
    assert image_size(path) == (width, height)
    pixels = decode(path, least).pixels
    factor = 2 if least else 1
    assert pixels.shape == (height // factor, width // factor, 3)
    border = 2 // factor
    inside = pixels[border:-border, border:-border] / 65535
    np.testing.assert_allclose(inside, 0.5, atol=0.01)


def test_a_crop_that_cannot_be_is_none(tmp_path):
    for crop in ((60, 0, 100, 64), (0, 0, 1, 1), (0, 0, 60000, 64)):
        path = write_dng(tmp_path / "a.dng", patches(COLOURS), crop=crop)
        assert image_size(path) == (128, 64) == decode(path).pixels.shape[1::-1]


def test_to_look_at_a_raw_photo_is_shown_in_srgb_at_half_its_size(tmp_path):
    path = write_dng(tmp_path / "a.dng", patches(COLOURS))
    assert decode(path, 64).pixels.shape == (32, 64, 3)
    assert decode(path, 65).pixels.shape == (64, 128, 3)
    colour, alpha = load_reduced(path, 64)
    assert alpha is None and colour.shape == (32, 64, 3)
    np.testing.assert_allclose(middles(colour, 16), 255 * linear_to_srgb(np.array(COLOURS)), atol=1.5)
    assert not may_have_alpha(path)


def test_raw_photos_are_known_by_what_is_in_them_whatever_they_are_called(tmp_path):
    raw = write_dng(tmp_path / "a.dng", patches(COLOURS))
    shutil.copy(raw, tmp_path / "b.tif")
    Image.fromarray(ramp()).save(tmp_path / "c.dng", "PNG")
    Image.fromarray(ramp()).save(tmp_path / "d.nef", "JPEG")
    write(tmp_path / "e.tif", ramp())
    assert {path.name for path in tmp_path.iterdir() if is_raw(path)} == {"a.dng", "b.tif"}
    np.testing.assert_array_equal(load(tmp_path / "b.tif").pixels, load(raw).pixels)
    assert decode(tmp_path / "c.dng").pixels.shape == decode(tmp_path / "d.nef").pixels.shape


def test_a_developed_tiff_that_is_called_raw_is_told(tmp_path):
    write(tmp_path / "a.tif", ramp()).rename(tmp_path / "a.nef")
    for read in (image_size, decode, read_header):
        with pytest.raises(CaptureError, match="a.nef: .*cannot be read; develop all to TIFF of 16 bits"):
            read(tmp_path / "a.nef")


def test_a_compression_that_libraw_lacks_is_told_with_the_way_out(tmp_path):
    path = write_dng(tmp_path / "a.dng", patches(COLOURS))
    jpeg_xl = struct.pack("<HHIH", 259, 3, 1, 52546)
    content = path.read_bytes()
    at = content.index(jpeg_xl[:8])
    path.write_bytes(content[:at] + jpeg_xl + content[at + len(jpeg_xl) :])
    assert image_size(path) == (128, 64)
    with pytest.raises(CaptureError, match="a.dng: .*cannot be read; develop all to TIFF of 16 bits"):
        decode(path)


@pytest.mark.parametrize("demosaiced", [False, True], ids=["mosaic", "colours"])
def test_a_merged_raw_photo_of_floating_point_is_refused_with_the_way_out(demosaiced, tmp_path):
    path = write_dng(tmp_path / "a.dng", patches(COLOURS), demosaiced=demosaiced, floating=True)
    for read in (image_size, decode, read_header):
        with pytest.raises(
            CaptureError, match="a.dng: .*floating-point.*; export all to OpenEXR, or to TIFF"
        ):
            read(path)


def test_a_merged_raw_photo_is_told_by_the_part_that_is_no_preview(tmp_path):
    path = tmp_path / "a.dng"
    version = (50706, "B", 4, bytes([1, 4, 0, 0]), True)
    with tifffile.TiffWriter(path) as file:
        small = np.zeros((4, 8, 3), np.uint8)
        file.write(small, photometric="rgb", subfiletype=1, subifds=1, extratags=[version])
        file.write(patches(COLOURS).astype(np.float32), photometric=34892, planarconfig=1)
    with pytest.raises(CaptureError, match="a.dng: .*floating-point"):
        image_size(path)


def test_of_a_raw_photo_and_its_copies_in_one_folder_the_furthest_developed_counts(tmp_path):
    for index in range(3):
        write_dng(tmp_path / f"IMG_{index}.DNG", patches(COLOURS))
        if index:
            (tmp_path / f"IMG_{index}.HEIC").write_bytes(b"heic")
    Image.fromarray(ramp()).save(tmp_path / "IMG_2.jpg")
    finder = PhotoFinder(tmp_path)
    assert [path.name for path in finder.pictures()] == ["IMG_0.DNG", "IMG_1.HEIC", "IMG_2.jpg"]
    for stated in ("IMG_2", "IMG_2.DNG", "elsewhere/IMG_2.NEF"):
        assert finder.find(stated).name == "IMG_2.jpg"
    assert finder.find("IMG_0.DNG").name == "IMG_0.DNG"
    own = PhotoFinder(tmp_path, anywhere=True)
    assert own.find(str(tmp_path / "IMG_2.DNG")).name == "IMG_2.DNG"


def solved(folder, width, height):
    """The capture of three raw photos whose cameras have a size."""
    frames = "".join(
        f'{{"file_path": "{n}.dng", "transform_matrix": [[1,0,0,{n}],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}},'
        for n in range(3)
    )
    (folder / "transforms.json").write_text(
        f'{{"w": {width}, "h": {height}, "fl_x": 100, "frames": [{frames[:-1]}]}}'
    )
    return read_capture(folder)


def test_a_capture_of_raw_photos_is_read_loaded_and_made_smaller(tmp_path):
    for number in range(3):
        write_dng(tmp_path / f"{number}.dng", patches(COLOURS))
    capture = solved(tmp_path, 128, 64)
    photos = load_photos(capture, most_pixels=2048)
    assert [photo.pixels.shape for photo in photos] == [(32, 64, 4)] * 3
    np.testing.assert_allclose(middles(photos[0].pixels, 16), COLOURS, atol=2 * ONE_CODE)


def test_cameras_of_photos_that_were_made_smaller_follow_but_not_those_of_another_border(tmp_path):
    for number in range(3):
        write_dng(tmp_path / f"{number}.dng", patches(COLOURS))
    assert solved(tmp_path, 64, 32).cameras[0].fx == 200
    with pytest.raises(CaptureError, match=r"photo is 128 × 64 pixels, but transforms.json says 132 × 66"):
        solved(tmp_path, 132, 66)


def test_blender_leaves_the_size_to_the_solver(tmp_path, monkeypatch):
    for number in range(3):
        write_dng(tmp_path / f"{number}.dng", patches(COLOURS))
    monkeypatch.setattr(image_header, "find_spec", lambda name: None)
    with pytest.raises(image_header.UnknownSize, match="0.dng: .*let Solve Cameras find the cameras"):
        image_size(tmp_path / "0.dng")
    assert solved(tmp_path, 132, 66).cameras[0].width == 132
    assert image_orientation(tmp_path / "0.dng") == 1 and not image_header.blender_shows(tmp_path / "0.DNG")


@pytest.mark.parametrize("length", [0, 3, 20, 200, 8000, -10])
def test_a_cut_raw_photo_is_told(length, tmp_path):
    path = write_dng(tmp_path / "a.dng", patches(COLOURS))
    path.write_bytes(path.read_bytes()[:length])
    with pytest.raises(CaptureError, match="a.dng: .*(cut off; replace|this is no PNG|damaged)") as caught:
        load_photo(camera_for(path, 128, 64))
    assert "\n" not in str(caught.value) and "b'" not in str(caught.value)


@pytest.mark.parametrize(
    "content", [b"", b"MM\0*", b"FUJIFILMCCD-RAW 0201", b"II*\0\x10\0\0\0CR\2\0", b"IIRO\x08\0\0\0\0\0",
                b"\0\0\0\x18ftypcrx \0\0\0\1crx isom", b"IIU\0\x18\0\0\0", b"\0MRM\0\0\0\0", b"text"]
)  # fmt: skip
def test_files_of_all_makers_that_hold_nothing_are_told(content, tmp_path):
    for name in ("a.nef", "a.cr3"):
        path = tmp_path / name
        for more in (b"", bytes(300), b"\xff" * 300):
            path.write_bytes(content + more)
            assert image_orientation(path) == 1
            for read in (image_size, decode, read_header):
                with pytest.raises(CaptureError, match=name) as caught:
                    read(path)
                assert "\n" not in str(caught.value)


@settings(max_examples=150, deadline=5000, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    keep=st.floats(0, 1),
    patched=st.lists(st.tuples(st.integers(0, 900), st.binary(max_size=6)), max_size=4),
)
def test_damaged_raw_photos_end_in_a_photo_or_an_error_of_one_line(tmp_path, keep, patched):
    path = write_dng(tmp_path / "a.dng", patches(COLOURS, 8), crop=(2, 2, 28, 12))
    whole = bytearray(path.read_bytes())
    for start, patch in patched:
        whole[start : start + len(patch)] = patch
    path.write_bytes(whole[: round(len(whole) * (0.7 + 0.3 * keep))])
    check_photo_or_error(path)


def test_a_header_that_claims_a_huge_picture_costs_nothing(tmp_path):
    path = write_dng(tmp_path / "a.dng", patches(COLOURS))
    size = struct.pack("<HHII", 256, 4, 1, 60000) + struct.pack("<HHII", 257, 4, 1, 60000)
    content = path.read_bytes()
    at = content.index(struct.pack("<HHI", 256, 4, 1))
    path.write_bytes(content[:at] + size + content[at + len(size) :])
    tracemalloc.start()
    start = time.monotonic()
    try:
        with pytest.raises(CaptureError, match="which no photo has"):
            load_photo(camera_for(path, 8, 8))
        assert time.monotonic() - start < 1
        assert tracemalloc.get_traced_memory()[1] < 1 << 20
    finally:
        tracemalloc.stop()


def exif(orientation):
    tiff = Image.Exif()
    tiff[0x0112] = orientation
    return tiff.tobytes()[6:]


def box(kind, content):
    return struct.pack(">I4s", 8 + len(content), kind) + content


def test_the_orientation_is_found_where_each_maker_has_it(tmp_path):
    """Heads of files, made by what is known of them: no camera's files are at hand."""
    tiff = exif(6)
    canon = bytes.fromhex("85c0b687820f11e08111f4ce462b6a48")
    jpeg = b"\xff\xd8\xff\xe1" + struct.pack(">H", 8 + len(tiff)) + b"Exif\0\0" + tiff
    files = {
        "a.cr3": box(b"ftyp", b"crx \0\0\0\1crx isom")
        + box(b"moov", box(b"uuid", canon + box(b"CNCV", b"x") + box(b"CMT1", tiff))),
        "a.raf": b"FUJIFILMCCD-RAW 0201".ljust(84, b"\0") + struct.pack(">II", 100, len(jpeg))
        + bytes(8) + jpeg,
        "a.rw2": b"IIU\0" + struct.pack("<IHHHIIHHII", 8, 2, 256, 4, 1, 9, 274, 3, 1, 6) + bytes(4),
        "a.nef": b"MM\0*" + struct.pack(">IHHHIHH", 8, 1, 274, 3, 1, 6, 0) + bytes(4),
    }  # fmt: skip
    for name, content in files.items():
        path = tmp_path / name
        path.write_bytes(content)
        assert is_raw(path) and image_orientation(path) == 6, name
        with path.open("rb") as file:
            assert raw_orientation(raw_exif(file)) == 6
        for length in range(len(content)):
            path.write_bytes(content[:length])
            assert image_orientation(path) in (1, 6)


def test_the_focal_length_in_exif_is_read(tmp_path):
    fields = struct.pack("<HHHIHHI", 1, 0xA405, 3, 1, 26, 0, 0)
    path = tmp_path / "a.rw2"
    path.write_bytes(b"IIU\0" + struct.pack("<IHHHIII", 8, 1, 0x8769, 4, 1, 26, 0) + fields)
    assert image_header.focal_35mm(path) == 26
    assert image_header.focal_35mm(tmp_path / "nowhere.nef") == 0


def test_what_the_tests_write_is_a_raw_photo_to_libraw(tmp_path):
    linear = patches(COLOURS)
    with rawpy.imread(str(write_dng(tmp_path / "a.dng", linear))) as raw:
        np.testing.assert_array_equal(raw.raw_image, mosaic(sensor_codes(linear)))
