"""The binary files of a COLMAP model (little-endian records behind a count)."""

import mmap
import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from ..errors import CaptureError
from ..files import head_of, no_access
from ..sparse_points import SparsePoints
from .colmap_model import MODELS, NAME_OF_ID, UNMOVED, Frames, Image, Rigs, Sensor

_COUNT = struct.Struct("<Q")
_SENSOR = struct.Struct("<IiQQ")  # id, model, width, height; parameters follow
_IMAGE = struct.Struct("<I7dI")  # id, pose, camera; name and observations follow
_OBSERVATION = 24  # x, y, point
_POINT = struct.Struct("<8x3d11xQ")  # id, position, colour, error, length of the track that follows
_TRACK = 8  # image, observation
_RIG = struct.Struct("<II")  # id, number of sensors, which follow
_SENSOR_ID = struct.Struct("<iI")  # kind, id
_POSE = struct.Struct("<7d")
_FRAME = struct.Struct("<II7dI")  # id, rig, pose, number of data
_DATUM = struct.Struct("<iIQ")  # kind and id of the sensor, image

LEAST = {
    "cameras": _SENSOR.size + 16,
    "images": _IMAGE.size + 1 + _COUNT.size,
    "points3D": _POINT.size,
    "rigs": _RIG.size,
    "frames": _FRAME.size,
}
"""bytes of the smallest record"""
_LONGEST_NAME = 4096
_CAMERA = 0  # kind of sensor
_REMEDY = "copy or export the model again"


def is_plausible(file: Path, kind: str) -> bool:
    """True if the file has room for as many records as it says, and its first one makes sense."""
    head = head_of(file, 8192)
    try:
        size = file.stat().st_size
        (count,) = _COUNT.unpack_from(head)
        if count * LEAST[kind] > size - _COUNT.size or (count == 0) != (size == _COUNT.size):
            return False
        if kind == "cameras" and count:
            return _SENSOR.unpack_from(head, 8)[1] in NAME_OF_ID
        if kind == "images" and count:
            pose = np.array(_IMAGE.unpack_from(head, 8)[1:8])
            return bool((np.abs(pose[:4]) < 1e3).all()) and b"\0" in head[8 + _IMAGE.size :]
    except (OSError, struct.error):
        return False
    return True


def read_cameras(file: Path) -> dict[int, Sensor]:
    """Cameras by id.

    Raises:
        CaptureError: the file breaks off or contradicts itself; so all below.
    """
    sensors = {}
    with _opened(file) as records:
        for index in range(records.count(LEAST["cameras"])):
            where = f"camera {index + 1}"
            number, model, width, height = records.take(_SENSOR, where)
            name = NAME_OF_ID.get(model)
            if name is None:
                raise CaptureError(
                    file, where, f"camera model {model} is not supported", f"use one of {', '.join(MODELS)}"
                )
            parameters = records.take(struct.Struct(f"<{MODELS[name][1]}d"), where)
            sensors[number] = Sensor(where, name, width, height, parameters)
    return sensors


def read_images(file: Path) -> list[Image]:
    """Images in the order of the file."""
    images = []
    with _opened(file) as records:
        for index in range(records.count(LEAST["images"])):
            where = f"image {index + 1}"
            number, *pose, sensor = records.take(_IMAGE, where)
            name = records.name(where)
            images.append(Image(where, number, tuple(pose), sensor, name))
            records.skip(records.take(_COUNT, where)[0] * _OBSERVATION, where)
    return images


def read_points(file: Path) -> np.ndarray:
    """Sparse points [N, 3], world."""
    points = SparsePoints()
    with _opened(file) as records:
        # Millions of turns: methods would take longer than the reading.
        count, data, at = records.count(LEAST["points3D"]), records.data, records.at
        unpack, size = _POINT.unpack_from, _POINT.size
        try:
            for _ in range(count):
                x, y, z, length = unpack(data, at)
                points.add(x, y, z)
                at += size + length * _TRACK
        except (struct.error, OverflowError) as error:
            raise _broken_off(file, "points") from error
        if at > records.size:
            raise _broken_off(file, "points")
    return points.array()


def read_rigs(file: Path) -> Rigs:
    """Rigs by id; the first sensor is the one the others' poses refer to."""
    rigs: Rigs = {}
    with _opened(file) as records:
        for index in range(records.count(LEAST["rigs"])):
            where = f"rig {index + 1}"
            number, count = records.take(_RIG, where)
            records.expect(count * _SENSOR_ID.size, where)
            cameras = rigs.setdefault(number, {})
            for place in range(count):
                kind, sensor = records.take(_SENSOR_ID, where)
                pose: tuple[float, ...] | None = UNMOVED
                if place > 0:
                    known = records.take(struct.Struct("<B"), where)[0]
                    pose = records.take(_POSE, where) if known else None
                if kind == _CAMERA:
                    cameras[sensor] = pose
    return rigs


def read_frames(file: Path) -> Frames:
    """For each image its rig and the rig's pose."""
    frames: Frames = {}
    with _opened(file) as records:
        for index in range(records.count(LEAST["frames"])):
            where = f"frame {index + 1}"
            _, rig, *pose, count = records.take(_FRAME, where)
            records.expect(count * _DATUM.size, where)
            for _ in range(count):
                kind, _, image = records.take(_DATUM, where)
                if kind == _CAMERA:
                    frames[image] = (rig, tuple(pose))
    return frames


def count_of(file: Path) -> int:
    """How many records the file says it has; 0 if it cannot be read or has no room for them."""
    head = head_of(file, _COUNT.size)
    return _COUNT.unpack(head)[0] if len(head) == _COUNT.size else 0


def _broken_off(file: Path, where: str) -> CaptureError:
    return CaptureError(file, where, "the file breaks off there", _REMEDY)


class _Records:
    """A position in a file's bytes that never passes their end."""

    def __init__(self, file: Path, data: bytes | mmap.mmap):
        self.file, self.data, self.at, self.size = file, data, 0, len(data)

    def expect(self, count: int, where: str) -> None:
        """Raise if fewer bytes are left."""
        if self.at + count > self.size:
            raise _broken_off(self.file, where)

    def take(self, form: struct.Struct, where: str) -> tuple:
        if self.at + form.size > self.size:
            self.expect(form.size, where)
        values = form.unpack_from(self.data, self.at)
        self.at += form.size
        return values

    def skip(self, count: int, where: str) -> None:
        if self.at + count > self.size:
            self.expect(count, where)
        self.at += count

    def count(self, least: int) -> int:
        """The number of records, of so many bytes at least."""
        (count,) = self.take(_COUNT, "count")
        if count * least > self.size - self.at:
            problem = f"it says it has {count} records but has no room for them"
            raise CaptureError(self.file, "count", problem, _REMEDY)
        return count

    def name(self, where: str) -> str:
        end = self.data.find(b"\0", self.at, min(self.size, self.at + _LONGEST_NAME))
        if end < 0:
            raise CaptureError(self.file, where, "the photo's name has no end", _REMEDY)
        name = self.data[self.at : end].decode("utf-8", "surrogateescape")
        self.at = end + 1
        return name


@contextmanager
def _opened(file: Path) -> Iterator[_Records]:
    try:
        with file.open("rb") as stream:
            if os.fstat(stream.fileno()).st_size == 0:
                yield _Records(file, b"")
                return
            with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
                yield _Records(file, data)
    except OSError as error:
        raise no_access(file, error) from error
