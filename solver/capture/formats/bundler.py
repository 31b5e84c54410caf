"""Bundler's `.out` files, version 0.3, with their list of photos.

Poses are camera from world with OpenGL's axes, the principal point is the photo's centre, distortion
f (1 + k1 r² + k2 r⁴). Cameras with f = 0 were not solved.
https://www.cs.cornell.edu/~snavely/bundler/bundler-v0.4-manual.html#S6
"""

import re
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path

import numpy as np

from ..errors import CaptureError, shown, told_of
from ..fields import number, rigid_pose
from ..files import CUT_OFF, read_lines, text_head
from ..frames import invert_pose
from ..image_header import EXTENSIONS as PICTURES
from ..image_header import image_size
from ..intake import Capture, Found, Intrinsics, PhotoFinder, assemble
from ..sparse_points import SparsePoints

NAME = "Bundler"
PATTERNS = (
    "bundle.out", "bundle/bundle.out", "bundle.rd.out", "pmvs/bundle.rd.out", "*.bundle.out",
    "*bundle*.out", "bundle/*.out",
)  # fmt: skip

_HEADER = b"# Bundle file v"
_LISTS = ("txt", "lst", "imagelist")
_NUMBERS = 15  # of a camera: f k1 k2, rotation, translation


def recognises(file: Path) -> bool:
    return text_head(file).startswith(_HEADER)


def read(path: Path, photos: PhotoFinder) -> Capture:
    lines = (line for line in read_lines(path) if line[1])
    version = next((line for _, line in lines), "")
    if not version.startswith(_HEADER.decode() + "0.3"):
        raise CaptureError(path, "line 1", f"'{shown(version)}' is not version 0.3", "export version 0.3")
    where, line = next(lines, ("line 2", ""))
    counts = line.split()
    if len(counts) != 2 or not all(w.isascii() and w.isdigit() and len(w) < 20 for w in counts):
        raise CaptureError(path, where, "it does not count cameras and points", CUT_OFF)
    camera_count, point_count = map(int, counts)
    # Names come after the cameras are read: a count may be anything, the cameras are there.
    cameras = _cameras(path, lines, camera_count)
    warnings, found = [], []
    names = _names(path, camera_count, photos, warnings.append)
    unsolved = [name for name, values in zip(names, cameras, strict=True) if values[0] <= 0]
    if unsolved:
        what = f"of {camera_count} photos was|were not solved and is|are left out"
        warnings.append(told_of(path, unsolved, what))
    for index, (name, values) in enumerate(zip(names, cameras, strict=True)):
        if values[0] > 0:
            found.append(_found(path, index, name, values, photos))
    points = SparsePoints()
    for place in range(point_count):
        try:
            position, _, _ = islice(lines, 3)
            x, y, z = map(float, position[1].split())
        except ValueError:
            warnings.append(f"{path.name}: its points break off after {place} of {point_count}")
            break
        points.add(x, y, z)
    return assemble(path, NAME, found, photos, points=points.array(), warnings=tuple(warnings))


def _found(path: Path, index: int, name: str, values: np.ndarray, photos: PhotoFinder) -> Found:
    field = f"camera {index}"
    photo = photos.find(name, beside=path)
    if photo is None:
        return Found(field, name, None, None, None)
    width, height = image_size(photo)
    focal, k1, k2 = map(float, values[:3])
    lens, distortion = ("opencv", (k1, k2, 0.0, 0.0, 0.0)) if k1 or k2 else ("pinhole", ())
    from_world = np.column_stack([values[3:12].reshape(3, 3), values[12:]])
    pose = invert_pose(rigid_pose(path, field, from_world))
    return Found(
        field, name, photo, pose,
        Intrinsics(width, height, focal, focal, width / 2, height / 2, lens, distortion),
    )  # fmt: skip


def _cameras(path: Path, lines: Iterator[tuple[str, str]], count: int) -> list[np.ndarray]:
    cameras: list[np.ndarray] = []
    values: list[float] = []
    where = "line 2"
    while len(cameras) < count:
        where, line = next(lines, (where, None))
        words = [] if line is None else line.split()
        if not words or len(values) + len(words) > _NUMBERS:
            raise CaptureError(path, where, f"camera {len(cameras)} of {count} breaks off", CUT_OFF)
        values += [number(path, where, word) for word in words]
        if len(values) == _NUMBERS:
            cameras.append(np.array(values))
            values = []
    return cameras


def _names(path: Path, count: int, photos: PhotoFinder, warn: Callable[[str], None]) -> list[str]:
    """What the photos are called, in the order of the cameras; `warn` is told where that is a guess."""
    file = _list_file(path) or _any_list(path, count)
    if file is not None:
        names = [_name(line) for _, line in read_lines(file) if line]
        if len(names) != count:
            raise CaptureError(
                file, "", f"it lists {len(names)} photos, but {path.name} has {count} cameras",
                "give the list that belongs to it",
            )  # fmt: skip
        return names
    pictures = photos.pictures()
    if len(pictures) != count:
        raise CaptureError(
            path, "list.txt", f"there is no list of photos beside it, and {photos.folder} has "
            f"{len(pictures)} pictures, not {count}", "copy Bundler's list.txt there",
        )  # fmt: skip
    warn(f"{path.name}: there is no list of its photos beside it, so they are taken in the order of their "
         "names; if cameras look the wrong way, copy list.txt there")  # fmt: skip
    return [picture.relative_to(photos.folder).as_posix() for picture in pictures]


def _list_file(path: Path) -> Path | None:
    stem = path.name.removesuffix(path.suffix)
    names = [f"{path.name}.list.txt", f"{stem}.list.txt", f"{stem.removesuffix('.bundle')}.list.txt"]
    usual = ["list.txt", "list.rd.txt"]
    names += reversed(usual) if stem.endswith(".rd") else usual
    beside = (folder / name for folder in (path.parent, path.parent.parent) for name in names)
    return next(filter(Path.is_file, beside), None)


def _any_list(path: Path, count: int) -> Path | None:
    """A text file beside the cameras, whatever it is called, of as many pictures' names as cameras;
    RealityScan's is an `.imagelist`."""
    for file in sorted(file for ending in _LISTS for file in path.parent.glob(f"*.{ending}")):
        try:
            names = [_name(line) for _, line in islice(read_lines(file), count + 1) if line]
        except CaptureError:
            continue
        if len(names) == count and all(name.lower().endswith(PICTURES) for name in names):
            return file
    return None


def _name(line: str) -> str:
    """A name without what Bundler may add: a zero and the focal length from the photo's header."""
    return re.sub(r"\s+0\s+[\d.eE+-]+$", "", line)
