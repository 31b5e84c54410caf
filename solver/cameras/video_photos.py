"""Photos from a video: spread evenly over it, each the sharpest frame of its time."""

import shutil
from collections.abc import Callable, Iterator
from itertools import dropwhile, groupby, islice, takewhile
from pathlib import Path

import numpy as np
import OpenEXR
from PIL import Image

from ..capture.colour import REC709
from ..capture.errors import CaptureError
from ..capture.sharpness import sharpness_of
from ..capture.video import Frame, frame_count, frames
from ..replacing import replace_file
from ..threads import thread_pool
from .folder import FEWEST_PHOTOS, photos_below

CANDIDATES = 5
"""frames that are compared for a photo, at most"""
FEWEST_FRAMES = 3
"""frames there are to be for a photo, if nobody says which: two in a row are the same"""
_LOOKED_AT = 800
"""pixels of the longer side at which frames are compared: blur that is finer hardly counts in a fit"""


def take_photos(
    video: Path, folder: Path, count: int, told: Callable[[float, str], None], span: range | None = None
) -> tuple[str, ...]:
    """Write a video's photos into a folder, which is there only when all of them are.

    JPEG, or linear OpenEXR where the video is HDR, named by their frames' numbers. A folder that is there
    already is taken as it is.

    Args:
        count: photos; fewer where the video is short.
        told: the share done and of what; may raise to stop.
        span: the frames to take them from, numbered by the video's clock; None: all, numbered as they come.

    Returns:
        Their names, in order.

    Raises:
        CaptureError: it is no video, or one of hardly any frames.
    """
    if not folder.is_dir():
        part = folder.with_name(folder.name + ".part")
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True, exist_ok=True)
        try:
            for done, frame in sharpest(video, count, span):
                write_photo(frame, part)
                told(done, "extracting photos from the video")
            if len(list(part.iterdir())) < FEWEST_PHOTOS:  # it is damaged
                raise _too_short(video)
        except BaseException:
            # On Windows a file that somebody looks at stays; what ended this is the news.
            shutil.rmtree(part, ignore_errors=True)
            raise
        replace_file(part, folder)
    return photos_below(folder)


def sharpest(video: Path, count: int, span: range | None = None) -> Iterator[tuple[float, Frame]]:
    """The sharpest frame of each of `count` equal parts of a video, with the share of it that is past.

    Args:
        span: as `take_photos`.

    Raises:
        CaptureError: as `take_photos`.
    """
    found, fewest = frames(video, by_clock=span is not None), 1
    if span is None:
        span, fewest = range(frame_count(video)), FEWEST_FRAMES
    first, total = span.start, len(span)
    parts = min(count, total // fewest)
    if parts < FEWEST_PHOTOS:
        raise _too_short(video)
    step = -(-total // (parts * CANDIDATES))
    within = takewhile(
        lambda frame: frame.number < span.stop, dropwhile(lambda frame: frame.number < first, found)
    )
    with thread_pool() as pool:
        for part, members in groupby(within, lambda f: (f.number - first) * parts // total):
            rivals = list(islice(members, 0, None, step))
            # A plain frame, which has no score, is the last choice.
            scores = np.nan_to_num(list(pool.map(_sharpness, rivals)), nan=-np.inf)
            yield min(1.0, (part + 1) / parts), rivals[int(scores.argmax())]


def write_photo(frame: Frame, folder: Path) -> None:
    """Write a frame into a folder, named by its number."""
    pixels = frame.pixels()
    path = folder / f"frame_{frame.number:06d}"
    if pixels.dtype == np.uint8:
        Image.fromarray(pixels).save(path.with_suffix(".jpg"), quality=95, subsampling=0)
        return
    # As small as a JPEG; half floats hold what a video does.
    header = {
        "compression": OpenEXR.DWAA_COMPRESSION, "type": OpenEXR.scanlineimage,
        "chromaticities": REC709,
    }  # fmt: skip
    OpenEXR.File(header, {"RGB": pixels.astype(np.float16)}).write(str(path.with_suffix(".exr")))


def _sharpness(frame: Frame) -> float:
    return sharpness_of(frame.grey(_LOOKED_AT).astype(np.float32))


def _too_short(video: Path) -> CaptureError:
    return CaptureError(
        video, "", "the video is too short for cameras",
        "walk around the object slowly for half a minute or more",
    )  # fmt: skip
