"""PNG photos that state their colours by numbers (cICP), as screenshots, phones' editors and Blender write."""

import io
import struct
import zlib

import numpy as np
import pytest
from PIL import Image, ImageCms

from solver.capture.colour import srgb_to_linear
from solver.capture.errors import CaptureError
from solver.capture.png_header import png_colours
from tests.capture.data.heif.make import ramp
from tests.capture.pictures import load
from tests.capture.test_phone_formats import P3_TO_REC709

P3, BT709 = 12, 1
SRGB, LINEAR, PQ, HLG = 13, 8, 16, 18
AT = 33
"""where chunks may begin: behind the header's"""


def chunk(kind, content):
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def write(path, primaries, transfer, before=b"", **options):
    buffer = io.BytesIO()
    Image.fromarray(ramp()).save(buffer, "png", **options)
    content = buffer.getvalue()
    stated = chunk(b"cICP", bytes([primaries, transfer, 0, 1]))
    path.write_bytes(content[:AT] + before + stated + content[AT:])
    return path


def test_primaries_that_a_png_states_by_number_become_rec_709(tmp_path):
    pixels = load(write(tmp_path / "a.png", P3, SRGB)).pixels[..., :3]
    expected = srgb_to_linear(ramp() / 255.0) @ np.transpose(P3_TO_REC709)
    np.testing.assert_allclose(pixels, expected, atol=2e-3)


def test_codes_of_light_are_light(tmp_path):
    pixels = load(write(tmp_path / "a.png", BT709, LINEAR)).pixels[..., :3]
    np.testing.assert_allclose(pixels, ramp() / 255.0, atol=1e-6)


@pytest.mark.parametrize("transfer, name", [(PQ, "PQ"), (HLG, "HLG")])
def test_a_png_for_hdr_screens_is_refused_with_the_way_out(tmp_path, transfer, name):
    with pytest.raises(CaptureError, match=rf"a.png.*HDR screens \({name}\).*convert the photos"):
        load(write(tmp_path / "a.png", 9, transfer))


def test_numbers_go_before_a_profile_and_a_gamma(tmp_path):
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    gamma = chunk(b"gAMA", struct.pack(">I", 100_000))
    both = write(tmp_path / "a.png", P3, SRGB, before=gamma, icc_profile=profile)
    alone = write(tmp_path / "b.png", P3, SRGB)
    np.testing.assert_array_equal(load(both).pixels, load(alone).pixels)


def test_other_files_and_those_cut_off_state_none(tmp_path):
    whole = write(tmp_path / "a.png", P3, SRGB).read_bytes()
    assert png_colours(tmp_path / "a.png") == (P3, SRGB)
    for content in (b"", b"\xff\xd8", whole[:7], whole[:40], whole[: AT + 10], whole[:AT] * 2):
        (tmp_path / "b.png").write_bytes(content)
        assert png_colours(tmp_path / "b.png") is None
    Image.fromarray(ramp()).save(tmp_path / "c.png")
    assert png_colours(tmp_path / "c.png") is None
