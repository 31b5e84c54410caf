"""Record3D's export "EXR + RGB", and its own .r3d files when unpacked.

    metadata.json (in .r3d: metadata) beside rgb/N.jpg (in .r3d: rgbd/N.jpg), N from 0

`K` is a 3 × 3 matrix, column by column, for pictures of `w` × `h`; `perFrameIntrinsicCoeffs`, in newer
exports, fx fy cx cy of each picture. A pose is qx qy qz qw tx ty tz: camera to world, in metres, with
OpenGL's camera axes. The world's +Y is up as ARKit has it; in recordings that start at the identity,
it is up in the first picture.
https://github.com/marek-simonik/record3d/issues/27, /36 and /42
"""

from pathlib import Path

import numpy as np

from ..fields import Entry, numbers
from ..files import json_head
from ..frames import rotation_from_quaternion
from ..intake import Capture, CaptureError, Found, Intrinsics, PhotoFinder, assemble

NAME = "Record3D"
PATTERNS = ("metadata.json", "metadata", "EXR_RGBD/metadata.json", "*/metadata.json", "*/metadata")

_PHOTO_FOLDERS = ("rgb", "rgbd")


def recognises(file: Path) -> bool:
    head = json_head(file, 1 << 24)
    return b'"poses"' in head and (b'"K"' in head or b'"perFrameIntrinsicCoeffs"' in head)


def read(path: Path, photos: PhotoFinder) -> Capture:
    content = Entry.of_file(path)
    poses = content.entries("poses")
    if not poses:
        raise content.error("poses", "there is no list of poses")
    values = np.stack([numbers(path, f"poses[{i}]", pose, 7) for i, pose in enumerate(poses)])
    if len(values) > 1 and np.ptp(values, axis=0).max() < 1e-9:
        raise CaptureError(
            path, "poses", "all poses are the same",
            "record with the LiDAR camera: Record3D does not follow the front camera",
        )  # fmt: skip
    size = _size(content)
    folder = next((name for name in _PHOTO_FOLDERS if (path.parent / name).is_dir()), "rgb")
    found = []
    for index, pose in enumerate(values):
        stated = f"{folder}/{index}.jpg"
        photo = photos.find_in(path.parent / folder, f"{index}.jpg")
        serves = photos.serves(photo)
        intrinsics = _intrinsics(content, index, size) if serves else None
        where = f"poses[{index}]"
        found.append(Found(where, stated, photo, _matrix(path, where, pose), intrinsics))
    return assemble(path, NAME, found, photos, up=(0, 1, 0), metric=True)


def _size(content: Entry) -> tuple[int, int]:
    width, height = content.number("w"), content.number("h")
    if not (1 <= width <= 1e6 and 1 <= height <= 1e6):
        raise content.error("w", "the pictures have no size")
    return int(width), int(height)


def _intrinsics(content: Entry, index: int, size: tuple[int, int]) -> Intrinsics:
    path, each = content.path, content.get("perFrameIntrinsicCoeffs")
    if isinstance(each, list) and index < len(each):
        fx, fy, cx, cy = numbers(path, f"perFrameIntrinsicCoeffs[{index}]", each[index], 4)
    else:
        k = content.get("K")
        if isinstance(k, list) and len(k) == 3:
            k = [value for column in k if isinstance(column, list) for value in column]
        fx, _, _, _, fy, _, cx, cy, _ = numbers(path, "K", k, 9)
    return Intrinsics(*size, float(fx), float(fy), float(cx), float(cy))


def _matrix(path: Path, where: str, pose: np.ndarray) -> np.ndarray:
    """Camera-to-world [3, 4] of qx qy qz qw tx ty tz."""
    if not 1e-3 < np.linalg.norm(pose[:4]) < 1e3:
        raise CaptureError(path, where, "its quaternion is not a rotation")
    return np.column_stack([rotation_from_quaternion(pose[[3, 0, 1, 2]]), pose[4:]])
