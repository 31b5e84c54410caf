"""Room on the disk: COLMAP aborts the process when its database cannot grow, and the database its log."""

import shutil
from pathlib import Path

from ..capture.errors import CaptureError

_LEAST_ROOM = 64 << 20
"""bytes on the disk without which nothing more is begun"""


def check_room(folder: Path, pictures: int, largest_size: int) -> None:
    """Make sure that a solve may go on in its folder.

    Args:
        pictures: that are about to lie there for a while.
        largest_size: the longest side of one, pixels.

    Raises:
        CaptureError: there is too little room.
    """
    needed = _LEAST_ROOM + pictures * 3 * largest_size**2
    free = shutil.disk_usage(folder).free
    if free < needed:
        raise CaptureError(
            folder, "", f"the disk is full: {free >> 20} MB are free, and {needed >> 20} MB are needed",
            "free space, then run it again to continue",
        )  # fmt: skip
