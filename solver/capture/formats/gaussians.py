"""`cameras.json` of 3D Gaussian splatting: the cameras a splat was trained with.

A list of one camera a photo: `img_name` without its extension, `width` and `height` in pixels, `fx`, `fy`,
and a camera-to-world pose with OpenCV's axes: `rotation`, row by row, and `position`. The lens is a pinhole
with its axis in the photo's centre. `input.ply` beside it holds the sparse points it began with; photos
lie elsewhere.
Kerbl et al. 2023, doi:10.1145/3592433; `camera_to_JSON` of their code.
"""

from contextlib import suppress
from pathlib import Path

from ..fields import Entry
from ..files import text_head
from ..frames import pose_opengl_from_opencv, rigid
from ..intake import Capture, CaptureError, Found, Intrinsics, PhotoFinder, assemble
from ..ply_points import read_ply_points

NAME = "Gaussian splatting"
PATTERNS = ("cameras.json", "*/cameras.json")

_POINTS = "input.ply"


def recognises(file: Path) -> bool:
    head = text_head(file, 1 << 14)
    return head[:1] == b"[" and b'"img_name"' in head and b'"rotation"' in head


def read(path: Path, photos: PhotoFinder) -> Capture:
    found = [_found(entry, photos) for entry in Entry.listed(path)]
    points = None
    if (path.parent / _POINTS).is_file():
        with suppress(CaptureError):  # they only help to find the bounds
            points = read_ply_points(path.parent / _POINTS)
    return assemble(path, NAME, found, photos, points=points)


def _found(camera: Entry, photos: PhotoFinder) -> Found:
    name = camera.name("img_name", "the camera names no photo")
    width, height, fx, fy = map(camera.number, ("width", "height", "fx", "fy"))
    pose = rigid(camera.matrix("rotation", (3, 3)), camera.numbers("position", 3))
    return Found(
        camera.where, name, photos.find(name), pose_opengl_from_opencv(pose),
        Intrinsics(int(width), int(height), fx, fy, width / 2, height / 2),
    )  # fmt: skip
