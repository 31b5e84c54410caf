"""CO3D's `frame_annotations.jgz` of a category, beside the folders of its sequences.

    apple/frame_annotations.jgz, apple/110_13051_23361/images/frame000001.jpg, …/masks/frame000001.png

A gzipped list in JSON of all frames: `sequence_name`, `image` (`path`; `size`, its height first) and
`viewpoint`. X R + T is a point X in PyTorch3D's camera axes, +X left, +Y up, the view along +Z; lengths are
halves of the photo's sides, or of the shorter one (ndc_isotropic), from the middle to the left and upwards.
https://github.com/facebookresearch/co3d (data_types.py, co3d_dataset.py)
"""

import gzip
import json
import re
import zlib
from contextlib import suppress
from itertools import islice
from pathlib import Path

import numpy as np

from ..camera_folder import MOST_FILES
from ..fields import Entry, pose_of_world
from ..files import CUT_OFF, head_of
from ..intake import Capture, CaptureError, Found, Intrinsics, PhotoFinder, assemble
from ..no_capture import several_in
from ..picture_names import pictures_below

NAME = "CO3D"
FILE = "frame_annotations.jgz"
PATTERNS = (FILE, f"*/{FILE}")


def recognises(file: Path) -> bool:
    """True for gzipped JSON that begins with a frame of a sequence."""
    with suppress(zlib.error):
        head = zlib.decompressobj(31).decompress(head_of(file), 1 << 12)
        return b'"sequence_name"' in head and b'"frame_number"' in head
    return False


def read(path: Path, photos: PhotoFinder) -> Capture:
    """Read the sequence that the photos' folder is of, or the only one beside the file with photos."""
    beside, folder = path.absolute().parent, photos.folder
    if beside.is_relative_to(folder):
        folders = [f for f in sorted(beside.iterdir()) if f.is_dir() and any(pictures_below(f))]
        if len(folders) > 1:
            raise several_in(beside, folders)
        folder = next(iter(folders), folder)
    begins = rf'\{{\s*"sequence_name"\s*:\s*{re.escape(json.dumps(folder.name))}'
    try:
        with gzip.open(path, "rt", encoding="utf-8") as file:
            text = file.read(1 << 29)  # a frame has a thousand
    except (EOFError, gzip.BadGzipFile, zlib.error) as error:
        raise CaptureError(path, "", f"it cannot be read as {NAME} ({error})", CUT_OFF) from error
    found, lost = [], []
    for index, match in enumerate(islice(re.finditer(begins, text), MOST_FILES)):
        frame = json.JSONDecoder().raw_decode(text, match.start())[0]
        frame = Entry(path, f"{folder.name}[{index}]", frame)
        if frame.get("viewpoint"):
            found.append(_camera(frame, photos))
        else:
            lost.append(frame.where)
    return assemble(
        path, NAME, found, photos, lost=(lost, "viewpoint", "solve the cameras from the photos")
    )


def _camera(frame: Entry, photos: PhotoFinder) -> Found:
    image, view = frame.inner("image"), frame.inner("viewpoint")
    stated, half = image.name("path", "the frame names no photo"), image.numbers("size", 2)[::-1] / 2
    unit = half.min() if view.get("intrinsics_format") == "ndc_isotropic" else half
    focal, centre = (view.numbers(key, 2) * unit for key in ("focal_length", "principal_point"))
    from_world = np.column_stack([view.matrix("R", (3, 3)).T, view.numbers("T", 3)]) * [[-1], [-1], [1]]
    pose = pose_of_world(frame.path, view.field("R"), from_world)
    lens = Intrinsics(*map(int, 2 * half), *focal, *(half - centre))
    return Found(view.field("R"), stated, photos.find(stated), pose, lens)
