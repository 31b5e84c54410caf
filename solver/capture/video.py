"""Frames of a video as photos: upright, with square pixels, deinterlaced, in colours that are known.

What a file says of its colours is taken by ITU-T H.273. Frames for ordinary screens are taken for sRGB,
as players show them; those of HDR videos become linear light.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain
from pathlib import Path

import av
import numpy as np
from av.container import InputContainer
from av.error import FFmpegError
from av.filter import Graph
from av.video.frame import VideoFrame
from av.video.reformatter import ColorRange, Colorspace, ColorTrc, Interpolation
from av.video.stream import VideoStream

from .colour import linear_from_hlg, linear_from_pq, linear_to_srgb, rec709_from_primaries, srgb_to_linear
from .errors import CaptureError
from .image_header import MOST_PIXELS

_CONTAINERS = "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpegts,mpeg,asf"
"""FFmpeg's names; of others, playlists can name files and addresses elsewhere"""
_HIGH_DEFINITION = 720
"""rows from which a video that does not say has Rec. 709's matrix, below Rec. 601's"""
_SMPTE170M = 6
"""H.273's number of a matrix that is Rec. 601's by another name, which PyAV has not"""
_HDR = {ColorTrc.SMPTE2084: linear_from_pq, ColorTrc.ARIB_STD_B67: linear_from_hlg}


@dataclass(frozen=True)
class Frame:
    """A decoded frame whose pixels are converted when they are asked for.

    Attributes:
        number: from 0, in the order in which frames are shown, or by the video's clock (see `frames`).
        width, height: upright, in square pixels.
    """

    number: int
    width: int
    height: int
    coded: VideoFrame

    def grey(self, longest: int) -> np.ndarray:
        """Encoded luminance [h, w] uint8, not turned, with a longest side of so many pixels at most."""
        coded = self.coded
        factor = min(1.0, longest / max(coded.width, coded.height))
        return self._as("gray", round(coded.width * factor), round(coded.height * factor))

    def pixels(self) -> np.ndarray:
        """sRGB [H, W, 3] uint8; of an HDR video linear Rec.709 [H, W, 3] float32, 1 being diffuse white."""
        turns = _quarter_turns(self.coded)
        size = (self.height, self.width) if turns % 2 else (self.width, self.height)
        to_linear = _HDR.get(self.coded.color_trc)
        matrix = rec709_from_primaries(int(self.coded.color_primaries))
        if to_linear is None and matrix is None:
            pixels = self._as("rgb24", *size)
        else:
            pixels = self._as("rgb48le", *size) / np.float32(65535)
            pixels = (to_linear or srgb_to_linear)(pixels)
            if matrix is not None:
                # Colours that Rec. 709 has not.
                pixels = (pixels @ matrix.T).clip(min=0)
            if to_linear is None:
                pixels = np.round(255 * linear_to_srgb(pixels.clip(max=1))).astype(np.uint8)
            else:
                pixels = pixels.astype(np.float32)
        return np.ascontiguousarray(np.rot90(pixels, turns))

    def _as(self, form: str, width: int, height: int) -> np.ndarray:
        coded = self.coded
        space = Colorspace.ITU601 if coded.colorspace == _SMPTE170M else coded.colorspace
        if space not in set(Colorspace):
            space = Colorspace.ITU709 if coded.height >= _HIGH_DEFINITION else Colorspace.ITU601
        full = coded.color_range == ColorRange.JPEG or coded.format.name.startswith("yuvj")
        reduced = width < coded.width
        return coded.reformat(
            max(width, 1), max(height, 1), form, src_colorspace=space,
            src_color_range=ColorRange.JPEG if full else ColorRange.MPEG,
            dst_color_range=ColorRange.JPEG,
            interpolation=Interpolation.AREA if reduced else Interpolation.BICUBIC,
        ).to_ndarray()  # fmt: skip


def _quarter_turns(coded: VideoFrame) -> int:
    """Counterclockwise, to what the file says is up."""
    return round(coded.rotation / 90)


def check_video(path: Path) -> None:
    """Make sure that a file is a video.

    Raises:
        CaptureError: it is none.
    """
    with _opened(path):
        pass


def frame_count(path: Path) -> int:
    """How many frames a video has; none is decoded.

    Raises:
        CaptureError: it is no video, or has none.
    """
    found = 0
    with _opened(path) as (container, stream):
        try:
            for packet in container.demux(stream):
                found += packet.size > 0
        except FFmpegError:
            pass  # cut off: what is before may do
    if found == 0:
        raise CaptureError(path, "", "the video has no frames", "give another, or a folder of photos")
    return found


def frames(path: Path, by_clock: bool = False) -> Iterator[Frame]:
    """The frames of a video in their order; of one that is cut off, those before.

    Args:
        by_clock: number them by when they are shown, as Blender counts: as many a second as the file says,
            which leaves numbers out where a phone has recorded fewer.

    Raises:
        CaptureError: it is no video.
    """
    with _opened(path) as (container, stream):
        stream.thread_type = "AUTO"
        shape = stream.sample_aspect_ratio or Fraction(1)
        number_of = _clock(stream) if by_clock else lambda number, coded: number
        try:
            for number, coded in enumerate(_shown(container, stream)):
                # The shorter side of a pixel is enlarged, so that nothing is lost.
                width = round(coded.width * max(shape, 1))
                height = round(coded.height / min(shape, 1))
                size = (height, width) if _quarter_turns(coded) % 2 else (width, height)
                yield Frame(number_of(number, coded), *size, coded)
        except FFmpegError:
            return


def _clock(stream: VideoStream) -> Callable[[int, VideoFrame], int]:
    """How frames are numbered by their times; frames without one count on."""
    rate, began = stream.guessed_rate or Fraction(25), None

    def number_of(number: int, coded: VideoFrame) -> int:
        nonlocal began
        if coded.pts is None or coded.time_base is None:
            return number
        shown = coded.pts * coded.time_base
        began = shown if began is None else began
        return round((shown - began) * rate)

    return number_of


def _shown(container: InputContainer, stream: VideoStream) -> Iterator[VideoFrame]:
    """Decoded frames, deinterlaced if they are interlaced."""
    decoded = container.decode(stream)
    try:
        first = next(decoded)
    except StopIteration:
        return
    if not first.interlaced_frame:
        yield from chain([first], decoded)
        return
    graph = Graph()
    graph.link_nodes(
        graph.add_buffer(template=stream), graph.add("bwdif", "mode=send_frame"), graph.add("buffersink")
    ).configure()
    for coded in chain([first], decoded, [None]):
        graph.push(coded)
        try:
            while True:
                yield graph.pull()
        except (BlockingIOError, EOFError):
            continue


@contextmanager
def _opened(path: Path) -> Iterator[tuple[InputContainer, VideoStream]]:
    try:
        options = {"format_whitelist": _CONTAINERS, "protocol_whitelist": "file"}
        container = av.open(str(path), container_options=options)
    except (FFmpegError, OSError) as error:
        raise _unreadable(path, error.strerror or "unknown") from error
    with container:
        stream = container.streams.best("video")
        if stream is None or stream.codec_context is None:
            raise _unreadable(path, "it has no pictures that can be decoded")
        width, height = stream.codec_context.width, stream.codec_context.height
        if not 0 < width * height <= MOST_PIXELS:
            raise _unreadable(path, f"it states {width} × {height} pixels, which no video has")
        yield container, stream


def _unreadable(path: Path, reason: str) -> CaptureError:
    return CaptureError(
        path, "", f"the video cannot be read ({reason})", "convert it to MP4, or give a folder of photos"
    )
