"""Photos' headers, memory, and files that are huge, damaged or something else."""

import struct
import time
import tracemalloc
import zlib

import numpy as np
import pytest
import tifffile
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from solver.capture import decoding
from solver.capture.decoding import decode
from solver.capture.errors import CaptureError
from solver.capture.image_header import image_orientation, image_size, may_have_alpha
from solver.capture.photos import (
    load_photo,
)
from solver.capture.reduced import read_header
from tests.capture.pictures import camera_for, load, ramp, write, write_exr, write_hdr


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
    + struct.pack("<4i", -(1 << 30), 0, 1 << 30, 9) + b"\0",
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


@pytest.mark.parametrize("name", ["a.exr", "a.tif"])
def test_a_photo_of_more_channels_than_memory_is_refused_before_it_is_decoded(tmp_path, monkeypatch, name):
    write(tmp_path / name, np.zeros((6, 10, 60), np.float32))
    assert decode(tmp_path / name).pixels.size
    monkeypatch.setattr(decoding, "_MOST_VALUES", 6 * 10 * 4)
    with pytest.raises(CaptureError, match=f"{name}, channels: it has 60 channels of 10 × 6"):
        decode(tmp_path / name)
    write(tmp_path / name, ramp(np.float32, 4))
    assert decode(tmp_path / name).pixels.shape == (6, 10, 4)


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


@pytest.mark.parametrize("order", ["+Y 6 +X 10", "-Y 6 -X 10", "+X 10 -Y 6", "-X 10 +Y 6"])
def test_radiance_files_whose_pixels_lie_in_another_order_are_refused(tmp_path, order):
    assert image_size(write_hdr(tmp_path / "a.hdr")) == (10, 6)
    write_hdr(tmp_path / "a.hdr", order=order)
    for read in (image_size, decode, read_header):
        with pytest.raises(CaptureError, match="a.hdr: .*another order of pixels"):
            read(tmp_path / "a.hdr")


@pytest.mark.parametrize("big", [False, True])
def test_a_tiff_that_begins_with_a_thumbnail_is_refused_and_one_that_ends_with_it_is_not(tmp_path, big):
    whole, small = ramp(np.uint8, 3, (24, 40)), ramp(np.uint8, 3, (6, 10))
    for name, pages in (("a.tif", ((small, 1), (whole, 0))), ("b.tif", ((whole, 0), (small, 1)))):
        with tifffile.TiffWriter(tmp_path / name, bigtiff=big) as file:
            for pixels, kind in pages:
                file.write(pixels, photometric="rgb", subfiletype=kind)
    for read in (image_size, decode, read_header):
        with pytest.raises(CaptureError, match="a.tif: .*first picture is a thumbnail"):
            read(tmp_path / "a.tif")
    np.testing.assert_array_equal(decode(tmp_path / "b.tif").pixels, whole)
    tifffile.imwrite(tmp_path / "c.tif", small, photometric="rgb", subfiletype=1, bigtiff=big)
    np.testing.assert_array_equal(decode(tmp_path / "c.tif").pixels, small)


@pytest.mark.parametrize(
    "name, channels, may",
    [("a.png", 3, False), ("a.png", 4, True), ("a.png", 1, False), ("a.jpg", 3, False), ("a.tif", 3, True)],
)
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


@settings(max_examples=150, deadline=5000, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    name=st.sampled_from(["a.png", "a.jpg", "a.tif", "a.exr", "a.hdr"]),
    keep=st.floats(0, 1), at=st.floats(0, 1), patch=st.binary(max_size=6),
)  # fmt: skip
def test_damaged_photos_end_in_a_photo_or_an_error_of_one_line(tmp_path, intact, name, keep, at, patch):
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
    with pytest.raises(
        CaptureError,
        match="no PNG, JPEG, WebP, HEIC, AVIF, TIFF, OpenEXR, Radiance HDR or camera raw",
    ):
        load_photo(camera_for(tmp_path / "a.png", 4, 4))
    (tmp_path / "b.png").mkdir()
    with pytest.raises(CaptureError, match="b.png: the image cannot be read"):
        image_size(tmp_path / "b.png")


@pytest.mark.parametrize("name", ["a.jpg", "a.png", "a.exr", "a.heic"])
def test_a_pointer_of_git_lfs_is_told_from_a_photo_of_another_kind(tmp_path, name):
    pointer = f"version https://git-lfs.github.com/spec/v1\noid sha256:{'0' * 64}\nsize 12345\n"
    (tmp_path / name).write_text(pointer)
    for read in (image_size, decode, read_header):
        with pytest.raises(CaptureError, match=f"{name}: .*Git LFS pointer.*run 'git lfs pull'"):
            read(tmp_path / name)
    (tmp_path / name).write_text(pointer[:20])
    with pytest.raises(CaptureError, match="convert the photo"):
        image_size(tmp_path / name)


def test_values_that_are_no_numbers_are_named(tmp_path):
    pixels = np.ones((4, 4, 3), np.float32)
    pixels[1, 1, 1] = np.nan
    with pytest.raises(CaptureError, match="a.exr: .*not numbers"):
        load(write_exr(tmp_path / "a.exr", pixels))


@pytest.mark.parametrize("orientation", range(1, 9))
def test_the_orientation_in_a_header_is_the_one_that_decoding_finds(tmp_path, orientation):
    exif = Image.Exif()
    exif[0x0112] = orientation
    for name in ("photo.jpg", "photo.tif"):
        Image.new("RGB", (6, 4), (90, 60, 30)).save(tmp_path / name, exif=exif)
        assert image_orientation(tmp_path / name) == decode(tmp_path / name).orientation
        assert image_orientation(tmp_path / name) == orientation
        assert image_size(tmp_path / name) == (6, 4)


def test_an_orientation_that_cannot_be_read_is_none(tmp_path):
    photo = tmp_path / "photo.jpg"
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.new("RGB", (6, 4)).save(photo, exif=exif)
    whole = photo.read_bytes()
    for length in range(len(whole)):
        photo.write_bytes(whole[:length])
        assert image_orientation(photo) in (1, 6)
    assert image_orientation(tmp_path / "nowhere.jpg") == 1


@pytest.mark.parametrize("stored", [(3, 2, 9, 5), (-2, -1, 12, 8), (4, -3, 20, 3), (0, 0, 9, 7)], ids=str)
def test_an_openexr_file_that_holds_a_part_or_more_is_the_picture_of_its_display_window(stored, tmp_path):
    x0, y0, x1, y1 = stored
    rows, columns = np.mgrid[y0 : y1 + 1, x0 : x1 + 1].astype(np.float32)
    held = np.stack([100 + columns, 200 + rows, columns, np.ones_like(rows)], axis=-1)
    windows = {
        "dataWindow": (np.array([x0, y0], np.int32), np.array([x1, y1], np.int32)),
        "displayWindow": (np.array([0, 0], np.int32), np.array([9, 7], np.int32)),
    }
    file = write_exr(tmp_path / "a.exr", held, **windows)
    assert image_size(file) == (10, 8)
    pixels = decode(file).pixels
    rows, columns = np.mgrid[:8, :10]
    inside = (rows >= y0) & (rows <= y1) & (columns >= x0) & (columns <= x1)
    assert pixels.shape == (8, 10, 4) and 0 < inside.sum()
    np.testing.assert_array_equal(pixels[..., 3], inside)
    np.testing.assert_array_equal(pixels[..., 0], np.where(inside, 100 + columns, 0))
    np.testing.assert_array_equal(pixels[..., 1], np.where(inside, 200 + rows, 0))
