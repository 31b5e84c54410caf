"""What the files of a COLMAP model say, binary or text; and COLMAP's camera models as our lenses.

https://colmap.github.io/format.html and https://colmap.github.io/cameras.html
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import CaptureError, shown
from ..frames import rigid, rotation_from_quaternion
from ..intake import Intrinsics
from ..panoramic_lens import EQUIRECTANGULAR, of_whole_sphere

KINDS = ("cameras", "images", "points3D", "rigs", "frames")

# Name: id in binary files, number of parameters, of them focal lengths, lens; the rest but the
# principal point is the lens's distortion. A panorama has its picture's width and height instead.
_PERSPECTIVE, _FISHEYE = "opencv", "opencv_fisheye"
MODELS: dict[str, tuple[int, int, int, str]] = {
    "SIMPLE_PINHOLE": (0, 3, 1, "pinhole"), "PINHOLE": (1, 4, 2, "pinhole"),
    "SIMPLE_RADIAL": (2, 4, 1, _PERSPECTIVE), "RADIAL": (3, 5, 1, _PERSPECTIVE),
    "OPENCV": (4, 8, 2, _PERSPECTIVE), "OPENCV_FISHEYE": (5, 8, 2, _FISHEYE),
    "FULL_OPENCV": (6, 12, 2, _PERSPECTIVE), "FOV": (7, 5, 2, "fov"),
    "SIMPLE_RADIAL_FISHEYE": (8, 4, 1, _FISHEYE), "RADIAL_FISHEYE": (9, 5, 1, _FISHEYE),
    "THIN_PRISM_FISHEYE": (10, 12, 2, "thin_prism_fisheye"),
    "RAD_TAN_THIN_PRISM_FISHEYE": (11, 16, 2, "rad_tan_thin_prism_fisheye"),
    "SIMPLE_DIVISION": (12, 4, 1, "division"), "DIVISION": (13, 5, 2, "division"),
    "SIMPLE_FISHEYE": (14, 3, 1, _FISHEYE), "FISHEYE": (15, 4, 2, _FISHEYE),
    "EUCM": (16, 6, 2, "eucm"), "EQUIRECTANGULAR": (17, 2, 0, EQUIRECTANGULAR),
}  # fmt: skip
NAME_OF_ID = {row[0]: name for name, row in MODELS.items()}


@dataclass(frozen=True)
class Sensor:
    """A line of the cameras file.

    Attributes:
        where: the line or record, for errors.
        width, height: pixels.
        parameters: in COLMAP's order.
    """

    where: str
    model: str
    width: int
    height: int
    parameters: tuple[float, ...]


@dataclass(frozen=True)
class Image:
    """A photo of the images file.

    Attributes:
        where: the line or record, for errors.
        pose: camera from world in OpenCV's axes: quaternion w x y z, translation x y z.
    """

    where: str
    number: int
    pose: tuple[float, ...]
    sensor: int
    name: str


Rigs = dict[int, dict[int, tuple[float, ...] | None]]
"""rig: its cameras, each with the pose camera from rig; None if that is unknown"""
Frames = dict[int, tuple[int, tuple[float, ...]]]
"""image: the rig that took it, and the pose rig from world"""
UNMOVED = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def pose_matrix(pose: tuple[float, ...]) -> np.ndarray:
    """[4, 4] of a quaternion w x y z and a translation; NaN if the quaternion is no rotation."""
    return rigid(rotation_from_quaternion(pose[:4]), pose[4:])


def intrinsics_of(file: Path, sensor: Sensor) -> Intrinsics:
    """A COLMAP camera as a lens of ours; all are one exactly.

    Raises:
        CaptureError: unknown models, a wrong number of parameters.
    """
    name = sensor.model.upper()
    if name not in MODELS:
        raise CaptureError(
            file, sensor.where, f"the camera model '{shown(sensor.model)}' is not supported",
            f"use one of {', '.join(MODELS)}",
        )  # fmt: skip
    _, count, focals, lens = MODELS[name]
    if len(sensor.parameters) != count:
        raise CaptureError(
            file, sensor.where, f"{name} has {count} parameters, not {len(sensor.parameters)}",
            "export the model again",
        )  # fmt: skip
    if lens == EQUIRECTANGULAR:
        return Intrinsics(sensor.width, sensor.height, *of_whole_sphere(*sensor.parameters), lens)
    fx, fy = sensor.parameters[0], sensor.parameters[focals - 1]
    cx, cy, *rest = sensor.parameters[focals:]
    if not any(rest) and lens == _PERSPECTIVE:
        lens, rest = "pinhole", []
    if lens == _FISHEYE:
        rest = [*rest, 0.0, 0.0, 0.0, 0.0][:4]
    elif lens == _PERSPECTIVE:
        rest = [*rest, 0.0, 0.0, 0.0, 0.0][: max(5, len(rest))]
    return Intrinsics(sensor.width, sensor.height, fx, fy, cx, cy, lens, tuple(rest))
