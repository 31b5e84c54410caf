"""Kapture, NAVER's format of cameras and other sensors: `sensors/sensors.txt` with others beside it.

Each is a table with commas, and a comment with the version first:

    sensors.txt         identity, name, camera, COLMAP's model, width, height, its parameters
    records_camera.txt  timestamp, sensor, path of a photo below records_data
    trajectories.txt    timestamp, sensor or rig, qw qx qy qz tx ty tz
    rigs.txt            rig, sensor or rig in it, qw qx qy qz tx ty tz
    ../reconstruction/points3d.txt    x, y, z, colour

A pose is from the world to the sensor, with OpenCV's camera axes, or from the rig to the sensor. Any file
of the folder stands for it. Photos without a pose are left out; the world has any unit, and any up.
https://github.com/naver/kapture/blob/main/kapture_format.adoc
"""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..errors import CaptureError, shown
from ..fields import check_quaternion, number, numbers
from ..files import CUT_OFF, read_lines, text_head
from ..frames import pose_of_opencv
from ..intake import Capture, Found, Intrinsics, PhotoFinder, assemble
from ..sparse_points import SparsePoints
from .colmap_model import Sensor, intrinsics_of, pose_matrix

NAME = "Kapture"
PATTERNS = ("sensors/sensors.txt", "sensors.txt", "*/sensors/sensors.txt")

_SENSORS = "sensors.txt"
_PHOTOS = "records_data"
_BEGINS = b"# kapture format:"
_KNOWN = re.compile(rb"# kapture format:\s*1\.\d+\s")

_Poses = dict[tuple[str, str], np.ndarray | None]
_Rigs = dict[str, list[tuple[str, np.ndarray]]]
"""of a sensor or rig: the rigs it is in, each with the pose rig to it"""


def recognises(file: Path) -> bool:
    return text_head(file).lower().startswith(_BEGINS) and file.with_name(_SENSORS).is_file()


def read(path: Path, photos: PhotoFinder) -> Capture:
    sensors_file = path.with_name(_SENSORS)
    if not _KNOWN.match(text_head(sensors_file).lower()):
        raise CaptureError(
            sensors_file, "line 1", "only version 1 of Kapture's format is supported",
            "export the data set in version 1.1",
        )  # fmt: skip
    sensors = {row[0]: (where, row) for where, row in _rows(sensors_file, 3)}
    records = path.with_name("records_camera.txt")
    poses = _poses(path.with_name("trajectories.txt"))
    rigs = _rigs(path.with_name("rigs.txt"))
    lenses: dict[str, Intrinsics] = {}
    found, lost = [], []
    for where, (time, key, stated) in _rows(records, 3, 3):
        from_world = _from_world(time, key, poses, rigs)
        if from_world is None:
            lost.append(stated)
            continue
        photo = photos.find(f"{_PHOTOS}/{stated}", beside=path)
        if photos.serves(photo) and key not in lenses:
            if key not in sensors:
                raise CaptureError(
                    records, where, f"there is no sensor '{shown(key)}' in {_SENSORS}", CUT_OFF
                )
            lenses[key] = _lens(sensors_file, *sensors[key])
        pose = pose_of_opencv(from_world)
        found.append(Found(f"{records.name}, {where}", stated, photo, pose, lenses.get(key)))
    lost = lost, "trajectories.txt", "solve their cameras, and export it again"
    points = _points(path.parent.parent / "reconstruction")
    return assemble(path, NAME, found, photos, points=points, lost=lost)


def _rows(path: Path, fewest: int, most: int = 0) -> Iterator[tuple[str, list[str]]]:
    """The rows of a table, each with the line it is on.

    Args:
        fewest: columns that there must be.
        most: columns that there are, the last of which may have commas; 0: any number.
    """
    for where, text in read_lines(path):
        if not text or text.startswith("#"):
            continue
        row = [word.strip() for word in text.split(",", most - 1)]
        if len(row) < fewest:
            raise CaptureError(path, where, f"'{shown(text)}' breaks off", CUT_OFF)
        yield where, row


def _poses(path: Path) -> _Poses:
    """Matrices [4, 4] of a table of poses by its first two columns; None for those that are left empty."""
    found: _Poses = {}
    for where, (first, second, *words) in _rows(path, 3):
        if not all(words):
            found[first, second] = None  # a place without a rotation, or the other way round
            continue
        pose = numbers(path, where, words, 7)
        check_quaternion(path, where, pose[:4], CUT_OFF)
        found[first, second] = pose_matrix(tuple(pose))
    return found


def _rigs(path: Path) -> _Rigs:
    """What is in which rigs; nothing, where there is no table of them."""
    found: _Rigs = {}
    for (rig, member), from_rig in (_poses(path) if path.is_file() else {}).items():
        if from_rig is not None:
            found.setdefault(member, []).append((rig, from_rig))
    return found


def _from_world(time: str, key: str, poses: _Poses, rigs: _Rigs) -> np.ndarray | None:
    """World to sensor [4, 4] at a time, by its own pose or that of the nearest rig it is in; None if not
    known."""
    seen, inside = {key}, [(key, np.eye(4))]
    for device, from_device in inside:  # which grows by the rigs that these are in
        if (pose := poses.get((time, device))) is not None:
            return from_device @ pose
        for rig, from_rig in rigs.get(device, []):
            if rig not in seen:
                seen.add(rig)
                inside.append((rig, from_device @ from_rig))
    return None


def _lens(path: Path, where: str, row: list[str]) -> Intrinsics:
    if row[2].lower() != "camera" or len(row) < 6:
        raise CaptureError(path, where, f"'{shown(', '.join(row))}' is not a camera with a lens", CUT_OFF)
    width, height, *parameters = (number(path, where, word) for word in row[4:])
    return intrinsics_of(path, Sensor(where, row[3], int(width), int(height), tuple(parameters)))


def _points(folder: Path) -> np.ndarray | None:
    file, points = folder / "points3d.txt", SparsePoints()
    if not file.is_file():
        return None
    for where, row in _rows(file, 3):
        points.add(*(number(file, where, word) for word in row[:3]))
    return points.array()
