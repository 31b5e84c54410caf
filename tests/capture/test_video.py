"""Frames of videos are upright, square, of the right colours, and hostile files only make a sentence."""

import struct
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solver.capture.colour import (
    PRIMARIES,
    linear_from_hlg,
    linear_from_pq,
    rec709_from_chromaticities,
)
from solver.capture.errors import CaptureError
from solver.capture.video import check_video, frame_count, frames
from tests.capture.videos import plain, write_video

COLOUR = (200, 100, 50)
REC601, REC709, REC2020 = 5, 1, 9
UNSAID = 2


@pytest.mark.parametrize(
    ("matrix", "said", "height"),
    [
        (REC601, UNSAID, 48),
        (REC709, UNSAID, 720),
        (REC709, REC709, 48),
        (REC601, 6, 720),
        (REC2020, REC2020, 48),
    ],
)
@pytest.mark.parametrize("full", [False, True])
def test_colours_are_those_that_were_coded_whatever_matrix_and_range(tmp_path, matrix, said, height, full):
    picture = plain(COLOUR, 64, height)
    path = write_video(tmp_path / "a.mp4", [picture], matrix=matrix, said=said, full=full)
    pixels = next(frames(path)).pixels()
    assert pixels.dtype == np.uint8 and pixels.shape == picture.shape
    assert np.abs(pixels.astype(int) - COLOUR).max() <= 2


def test_a_recording_of_a_screen_keeps_its_codes(tmp_path):
    path = write_video(tmp_path / "a.mov", [plain((200, 16, 3))], form="rgb24", codec="png")
    assert (next(frames(path)).pixels() == (200, 16, 3)).all()


def _signal(value):
    return plain(tuple(round(65535 * v) for v in value), kind=np.uint16)


def test_hdr_of_a_phone_becomes_linear_light_with_diffuse_white_at_one(tmp_path):
    pictures = [_signal((0.75,) * 3), _signal((0.75, 0.5, 0.5))]
    path = write_video(tmp_path / "a.mp4", pictures, matrix=REC2020, said=REC2020, transfer=18, primaries=9)
    white, red = (frame.pixels() for frame in frames(path))
    assert white.dtype == np.float32
    assert np.allclose(white, 1, atol=0.02)
    # BT.2100: half the signal is a twelfth of the peak; three quarters are 0.265 of it.
    linear = np.array([1, 1 / 12 / 0.26496, 1 / 12 / 0.26496])
    expected = rec709_from_chromaticities(PRIMARIES[9]) @ linear
    assert np.allclose(red, expected, atol=0.02)


def test_colours_that_rec709_has_not_are_black_in_the_channel_they_lack(tmp_path):
    path = write_video(
        tmp_path / "a.mp4", [_signal((0.0, 0.75, 0.0))], matrix=REC2020, said=REC2020, transfer=18,
        primaries=9,
    )  # fmt: skip
    pixels = next(frames(path)).pixels()
    assert pixels[..., 0].max() == 0 and pixels[..., 1].min() > 1


def test_pq_becomes_linear_light_with_diffuse_white_at_203_candelas(tmp_path):
    picture = _signal((0.5807,) * 3)
    path = write_video(
        tmp_path / "a.mp4", [picture], matrix=REC2020, said=REC2020, transfer=16, primaries=9
    )
    assert np.allclose(next(frames(path)).pixels(), 1, atol=0.03)


def test_display_p3_becomes_rec709(tmp_path):
    path = write_video(
        tmp_path / "a.mp4", [plain((180, 120, 120))], matrix=REC709, said=REC709, primaries=12
    )
    # By the matrix of linear P3 to sRGB, CSS Color 4: 1.2249 −0.2247, −0.0421 1.0419, −0.0196 −0.0786 1.0979
    pixels = next(frames(path)).pixels()
    assert pixels.dtype == np.uint8
    assert np.abs(pixels[0, 0].astype(int) - (190, 117, 118)).max() <= 2


def test_hdr_curves_have_the_values_of_the_standards():
    # BT.2408, table 1 and BT.2100, tables 4 and 5
    assert linear_from_hlg(np.array([0.0, 0.75])) == pytest.approx([0, 1])
    assert linear_from_hlg(np.array([1.0]))[0] == pytest.approx(1 / 0.26496, rel=1e-3)
    assert linear_from_pq(np.array([0.0]))[0] == 0
    candelas = 203 * linear_from_pq(np.array([0.508, 0.5807, 0.7518, 1.0]))
    assert candelas == pytest.approx([100, 203, 1000, 10_000], rel=5e-3)
    steps = np.linspace(0, 1, 1000)
    for curve in (linear_from_hlg, linear_from_pq):
        assert (np.diff(curve(steps)) > 0).all()


def _marked(width=64, height=48):
    """Grey with a white mark at its top left."""
    picture = plain((90, 90, 90), width, height)
    picture[: height // 4, : width // 4] = 255
    return picture


def _where_the_track_puts_the_top_left(data: bytes) -> tuple[float, float]:
    """By the matrix of an MP4's track header, in the picture's own axes about its middle."""
    at = data.index(b"tkhd")
    version = data[at + 4]
    start = at + 8 + (32 if version else 20) + 16
    a, b, _, c, d, _, _, _, _ = struct.unpack(">9i", data[start : start + 36])
    x, y = -1, -1
    return a * x + c * y, b * x + d * y


@pytest.mark.parametrize("rotation", [0, 90, 180, -90])
def test_frames_are_turned_as_the_track_says(tmp_path, rotation):
    path = write_video(tmp_path / "a.mp4", [_marked()], rotation=rotation)
    frame = next(frames(path))
    pixels = frame.pixels()
    assert pixels.shape == (frame.height, frame.width, 3)
    assert pixels.shape[:2] == ((48, 64) if rotation % 180 == 0 else (64, 48))
    x, y = _where_the_track_puts_the_top_left(path.read_bytes())
    row, column = (2 if y < 0 else -3), (2 if x < 0 else -3)
    corners = {(r, c): int(pixels[r, c].min()) for r in (2, -3) for c in (2, -3)}
    assert corners.pop((row, column)) > 240
    assert max(corners.values()) < 120


@pytest.mark.parametrize(("pixel", "size"), [(Fraction(4, 3), (85, 48)), (Fraction(3, 4), (64, 64))])
def test_pixels_become_square_without_losing_any(tmp_path, pixel, size):
    frame = next(frames(write_video(tmp_path / "a.mp4", [_marked()], pixel=pixel)))
    assert (frame.width, frame.height) == size
    assert frame.pixels().shape == (size[1], size[0], 3)


def test_interlaced_frames_have_no_combs(tmp_path):
    pictures = []
    for i in range(8):
        picture = plain((30, 30, 30), 128, 96)
        for field in (0, 1):
            picture[field::2, 8 * i + 4 * field : 8 * i + 4 * field + 40] = 220
        pictures.append(picture)
    woven = pictures[3].astype(int)
    path = write_video(tmp_path / "a.mp4", pictures, interlaced=True, form="yuv420p")
    found = list(frames(path))
    assert len(found) == len(pictures) == frame_count(path)
    pixels = found[3].pixels().astype(int)

    def combs(picture):
        return np.abs(2 * picture[1:-1] - picture[:-2] - picture[2:]).mean()

    assert combs(pixels) < 0.25 * combs(woven)


def test_the_grey_picture_is_reduced_and_as_bright(tmp_path):
    frame = next(frames(write_video(tmp_path / "a.mp4", [plain((90, 90, 90), 128, 96)])))
    assert frame.grey(64).shape == (48, 64) and frame.grey(1000).shape == (96, 128)
    assert np.abs(frame.grey(64).astype(int) - 90).max() <= 1


def test_a_video_that_is_cut_off_gives_the_frames_before(tmp_path):
    noise = np.random.default_rng(0).integers(0, 255, (30, 48, 64, 3), dtype=np.uint8)
    whole = write_video(tmp_path / "a.mkv", list(noise))
    assert frame_count(whole) == len(list(frames(whole))) == 30
    cut = tmp_path / "cut.mkv"
    data = whole.read_bytes()
    cut.write_bytes(data[: len(data) // 2])
    assert 5 < len(list(frames(cut))) < 25


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("text.mp4", b"not a video"),
        ("empty.mov", b""),
        ("playlist.mp4", b"#EXTM3U\n#EXTINF:1,\nother.mp4\n"),
        ("list.mkv", b"ffconcat version 1.0\nfile other.mp4\n"),
    ],
)
def test_what_is_no_video_is_refused_in_a_sentence(tmp_path, name, content):
    write_video(tmp_path / "other.mp4", [_marked()])
    path = tmp_path / name
    path.write_bytes(content)
    for read in (check_video, frame_count, lambda path: list(frames(path))):
        with pytest.raises(CaptureError, match="the video cannot be read") as error:
            read(path)
        assert name in str(error.value) and "MP4" in str(error.value)


def test_a_file_with_sound_only_is_refused(tmp_path):
    import wave

    path = tmp_path / "a.avi"
    with wave.open(str(path), "wb") as sound:
        sound.setparams((1, 2, 8000, 0, "NONE", ""))
        sound.writeframes(bytes(800))
    with pytest.raises(CaptureError):
        frame_count(path)


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    return write_video(tmp_path_factory.mktemp("video") / "a.mp4", [_marked()] * 6).read_bytes()


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_damaged_videos_never_crash(tmp_path_factory, good, data):
    damaged = bytearray(good)
    for _ in range(data.draw(st.integers(1, 8))):
        damaged[data.draw(st.integers(0, len(good) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path_factory.mktemp("damaged") / "a.mp4"
    path.write_bytes(damaged[: data.draw(st.integers(0, len(good)))])
    try:
        frame_count(path)
        for frame in frames(path):
            assert frame.pixels().shape == (frame.height, frame.width, 3)
    except CaptureError as error:
        assert "a.mp4" in str(error)
