"""VisualSFM's `.nvm` files, version 3.

A camera is its photo, focal length, rotation camera from world with OpenCV's axes (a quaternion
w x y z), its position, and one number r of distortion: with d measured from the photo's centre in
focal lengths, the ideal image of d is d (1 + r |d|²). COLMAP exports −k as r, which is that to
first order. The optional `FixedK fx cx fy cy` is a calibration for all.
http://ccwu.me/vsfm/doc.html#nvm
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..errors import CaptureError, shown
from ..fields import numbers, rigid_pose
from ..files import CUT_OFF, read_lines, text_head
from ..frames import invert_pose, pose_opengl_from_opencv, rigid, rotation_from_quaternion
from ..image_header import image_size
from ..intake import Capture, Found, Intrinsics, PhotoFinder, assemble
from ..sparse_points import SparsePoints

NAME = "VisualSFM"
PATTERNS = ("*.nvm", "*/*.nvm")


def recognises(file: Path) -> bool:
    return text_head(file).startswith(b"NVM_V")


def read(path: Path, photos: PhotoFinder) -> Capture:
    """Read the first model of an `.nvm` file, which is the largest."""
    lines = (line for line in read_lines(path) if line[1])
    version = next((line for _, line in lines), "")
    head = version.split()
    if not head or head[0] not in ("NVM_V3", "NVM_V3_R9T"):
        raise CaptureError(path, "line 1", f"'{shown(version)}' is not version 3", "export version 3")
    calibration = None
    if len(head) > 1 and head[1] == "FixedK":
        calibration = numbers(path, "line 1, FixedK", head[2:], 4)
        if calibration[0] <= 0:
            raise CaptureError(path, "line 1, FixedK", "fx is not positive", "correct it")
    count = _count(path, lines)
    found = []
    for index in range(count):
        where, line = next(lines, (f"camera {index}", None))
        if line is None:
            raise CaptureError(path, where, f"the file ends before its {count} cameras", CUT_OFF)
        found.append(_found(path, where, line, head[0].endswith("R9T"), calibration, photos))
    points, warnings = _points(path, lines)
    return assemble(path, NAME, found, photos, points=points, warnings=tuple(warnings))


def _found(
    path: Path, where: str, line: str, has_matrix: bool, calibration: np.ndarray | None, photos: PhotoFinder
) -> Found:
    rotation_size = 9 if has_matrix else 4
    name, values = _name_and_numbers(path, where, line, 1 + rotation_size + 5)
    focal, rotation, place = float(values[0]), values[1 : 1 + rotation_size], values[-5:-2]
    photo = photos.find(name, beside=path)
    if photo is None:
        return Found(where, name, None, None, None)
    if has_matrix:
        to_world = invert_pose(rigid_pose(path, where, rigid(rotation.reshape(3, 3), place)))
    else:
        to_world = rigid(rotation_from_quaternion(rotation).T, place)
    width, height = image_size(photo)
    aspect, cx, cy = 1.0, width / 2, height / 2
    if calibration is not None:
        aspect, cx, cy = calibration[2] / calibration[0], calibration[1], calibration[3]
    bend = float(values[-2])
    lens, distortion = ("visualsfm", (bend,)) if bend else ("pinhole", ())
    return Found(
        where, name, photo, pose_opengl_from_opencv(to_world),
        Intrinsics(width, height, focal, focal * aspect, cx, cy, lens, distortion),
    )  # fmt: skip


def _name_and_numbers(path: Path, where: str, line: str, count: int) -> tuple[str, np.ndarray]:
    """A photo's name, which may hold blanks, and the numbers behind it."""
    if "\t" in line:
        name, rest = line.split("\t", 1)
        values = rest.split()
    else:
        name, *values = line.rsplit(maxsplit=count)
    # VisualSFM itself writes a quotation mark for each blank of a name, others put names in them.
    name = name.strip().strip('"').replace('"', " ")
    return name, numbers(path, where, values, count)


def _count(path: Path, lines: Iterator[tuple[str, str]]) -> int:
    where, line = next(lines, ("line 2", ""))
    if not (line.isascii() and line.isdigit() and len(line) < 20):
        raise CaptureError(path, where, f"'{shown(line)}' is not a number of cameras", CUT_OFF)
    return int(line)


def _points(path: Path, lines: Iterator[tuple[str, str]]) -> tuple[np.ndarray, list[str]]:
    points = SparsePoints()
    done = 0
    try:
        count = _count(path, lines)
        while done < count:
            x, y, z, _ = next(lines, ("", ""))[1].split(maxsplit=3)
            points.add(float(x), float(y), float(z))
            done += 1
    except ValueError:
        return points.array(), [f"{path.name}: its points break off after {done}"]
    more = next(lines, ("", "0"))[1]
    if more.isascii() and more.isdigit() and more.strip("0"):
        return points.array(), [f"{path.name}: it holds further models, which are left out"]
    return points.array(), []
