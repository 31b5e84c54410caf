"""Videos for tests, encoded by FFmpeg."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.video.frame import VideoFrame


def write_video(
    path: Path, pictures: Sequence[np.ndarray], rotation: int = 0, matrix: int = 5, said: int = 2,
    transfer: int = 2, primaries: int = 2, full: bool = False, pixel: Fraction = Fraction(1),
    interlaced: bool = False, form: str = "yuv444p", codec: str = "libx264",
    ticks: Sequence[int] | None = None,
) -> Path:  # fmt: skip
    """Write pictures [H, W, 3], uint8 or uint16, almost without loss, the same on any machine.

    Args:
        rotation: degrees counterclockwise by which a player turns it.
        matrix: H.273's number of the one it is coded with. said, transfer, primaries: what the file says.
        full: codes from 0 to 255, and says so.
        pixel: width over height of a pixel.
        ticks: when each picture is shown, in 25ths of a second; None: one after the other.
    """
    deep = pictures[0].dtype == np.uint16
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25)
        stream.height, stream.width = pictures[0].shape[:2]
        stream.pix_fmt = f"{form}10le" if deep else form
        if codec == "libx264":
            stream.options = {"crf": "1", "preset": "ultrafast"}
        if interlaced:
            stream.options |= {"x264-params": "interlaced=1:tff=1"}
        context = stream.codec_context
        context.thread_count = 1
        context.sample_aspect_ratio = pixel
        context.colorspace, context.color_trc, context.color_primaries = said, transfer, primaries
        context.color_range = 2 if full else 1
        if rotation:
            stream.set_display_rotation(rotation)
        for tick, picture in zip(ticks or range(len(pictures)), pictures, strict=True):
            frame = VideoFrame.from_ndarray(picture, "rgb48le" if deep else "rgb24")
            coded = (
                frame
                if form == "rgb24"
                else frame.reformat(
                    format=stream.pix_fmt, dst_colorspace=matrix, dst_color_range=2 if full else 1
                )
            )
            coded.colorspace, coded.color_range = said, 2 if full else 1
            coded.pts, coded.time_base = tick, Fraction(1, 25)
            container.mux(stream.encode(coded))
        container.mux(stream.encode())
    return path


def plain(colour: tuple[int, ...], width: int = 64, height: int = 48, kind=np.uint8) -> np.ndarray:
    """A picture of one colour."""
    return np.full((height, width, 3), colour, kind)
