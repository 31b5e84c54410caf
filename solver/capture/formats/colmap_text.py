"""The text files of a COLMAP model: a line for a record, for an image two."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..errors import CaptureError, shown
from ..fields import number as checked_number
from ..files import head_of, read_lines
from ..sparse_points import SparsePoints
from .colmap_model import KINDS, MODELS, UNMOVED, Frames, Image, Rigs, Sensor

_HEADERS = {
    b"# Camera list with": "cameras",
    b"# Image list with": "images",
    b"# 3D point list with": "points3D",
    b"# Rig calib list": "rigs",
    b"# Frame list with": "frames",
}
_CAMERA = "CAMERA"  # kind of sensor
_REMEDY = "export the model again"


def kind_of(file: Path) -> str | None:
    """Which of `KINDS` a text file is, by COLMAP's comment on top or by its first line of data.

    Points, rigs and frames without the comment are only known by their conventional names.
    """
    head = head_of(file).removeprefix(b"\xef\xbb\xbf")
    if b"\0" in head:
        return None
    lines = [line.strip() for line in head.splitlines()]
    for line in lines[:8]:
        for header, kind in _HEADERS.items():
            if line.startswith(header):
                return kind
    data = next((line for line in lines if line and not line.startswith(b"#")), b"")
    words = data.decode("utf-8", "replace").split()
    if len(words) >= 6 and words[1].upper() in MODELS and _are_numbers([words[0], *words[2:]]):
        return "cameras"
    if len(words) >= 10 and _are_numbers(words[:9]) and not _are_numbers(words[9:10]):
        # The camera is a whole number, the quaternion's length is about 1.
        length = math.hypot(*(float(word) for word in words[1:5]))
        return "images" if words[0].isdigit() and words[8].isdigit() and length < 2 else None
    named = {kind.lower(): kind for kind in KINDS[2:]}.get(file.stem.lower())
    if named == "points3D":
        return named if len(words) >= 8 and _are_numbers(words[:8]) else None
    return named if _CAMERA in words else None


def read_cameras(file: Path) -> dict[int, Sensor]:
    """Cameras by id.

    Raises:
        CaptureError: a line that is none of its kind; so all below.
    """
    sensors = {}
    for where, line in _lines(file):
        words = line.split()
        if len(words) < 5:
            raise CaptureError(file, where, "this is not a camera", _REMEDY)
        number, width, height = (_whole(file, where, words[i]) for i in (0, 2, 3))
        parameters = tuple(checked_number(file, where, word) for word in words[4:])
        sensors[number] = Sensor(where, words[1], width, height, parameters)
    return sensors


def read_images(file: Path) -> list[Image]:
    """Images in the order of the file. The line of observations may be missing."""
    images, may_be_observations = [], False
    for where, line in _lines(file, with_empty=True):
        if may_be_observations and _is_observations(line):
            may_be_observations = False
            continue
        if not line:
            continue
        words = line.split(maxsplit=9)
        if len(words) < 10:
            raise CaptureError(file, where, "this is not an image", _REMEDY)
        pose = tuple(_number(file, where, word) for word in words[1:8])
        number, sensor = _whole(file, where, words[0]), _whole(file, where, words[8])
        images.append(Image(where, number, pose, sensor, words[9]))
        may_be_observations = True
    return images


def read_points(file: Path) -> np.ndarray:
    points = SparsePoints()
    for where, line in read_lines(file):
        if not line or line.startswith("#"):
            continue
        try:
            _, x, y, z, _ = line.split(maxsplit=4)
            points.add(float(x), float(y), float(z))
        except ValueError as error:
            raise CaptureError(file, where, "this is not a point", _REMEDY) from error
    return points.array()


def read_rigs(file: Path) -> Rigs:
    rigs: Rigs = {}
    for where, line in _lines(file):
        words = _Words(file, where, line)
        cameras = rigs.setdefault(words.whole(), {})
        for place in range(words.count()):
            kind, sensor = words.take(), words.whole()
            pose: tuple[float, ...] | None = UNMOVED
            if place > 0:
                pose = words.pose() if words.take() == "1" else None
            if kind == _CAMERA:
                cameras[sensor] = pose
    return rigs


def read_frames(file: Path) -> Frames:
    frames: Frames = {}
    for where, line in _lines(file):
        words = _Words(file, where, line)
        words.take()
        rig, pose = words.whole(), words.pose()
        for _ in range(words.count()):
            kind, _, image = words.take(), words.whole(), words.whole()
            if kind == _CAMERA:
                frames[image] = (rig, pose)
    return frames


class _Words:
    def __init__(self, file: Path, where: str, line: str):
        self.file, self.where, self.rest = file, where, line.split()[::-1]

    def take(self) -> str:
        if not self.rest:
            raise CaptureError(self.file, self.where, "the line breaks off", _REMEDY)
        return self.rest.pop()

    def whole(self) -> int:
        return _whole(self.file, self.where, self.take())

    def count(self) -> int:
        count = self.whole()
        if count > len(self.rest):
            raise CaptureError(self.file, self.where, "the line breaks off", _REMEDY)
        return count

    def pose(self) -> tuple[float, ...]:
        return tuple(_number(self.file, self.where, self.take()) for _ in range(7))


def _lines(file: Path, with_empty: bool = False) -> Iterator[tuple[str, str]]:
    for where, line in read_lines(file):
        if not line.startswith("#") and (line or with_empty):
            yield where, line


def _is_observations(line: str) -> bool:
    """True for an empty line, or x y point, x y point, …"""
    words = line[:400].split()
    if len(line) > 400:
        words.pop()  # it may be cut
    elif len(words) % 3:
        return False
    return _are_numbers(words)


def _are_numbers(words: list[str]) -> bool:
    try:
        return all(float(word) is not None for word in words)
    except ValueError:
        return False


def _number(file: Path, where: str, word: str) -> float:
    """A number that may be NaN: COLMAP writes such poses for images it has not solved."""
    try:
        return float(word)
    except ValueError as error:
        raise CaptureError(file, where, f"'{shown(word)}' is not a number", _REMEDY) from error


def _whole(file: Path, where: str, word: str) -> int:
    if not (word.isascii() and word.isdigit() and len(word) < 20):
        raise CaptureError(file, where, f"'{shown(word)}' is not a number of its kind", _REMEDY)
    return int(word)
