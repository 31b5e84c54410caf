"""`transforms.json`: the camera file of NeRF-synthetic, instant-ngp and nerfstudio.

All three give camera-to-world matrices with OpenGL camera axes. Intrinsics come as `camera_angle_x`
or `fl_x` (pixels), for all frames or for each; lens distortion as OpenCV's k1 k2 p1 p2. nerfstudio's
`applied_transform` says how the poses were moved before writing; the world is taken as written.
"""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np

from ..camera import Camera
from ..capture import Capture
from ..errors import CaptureError, shown
from ..files import head_of, read_json
from ..files import number as checked_number
from ..image_header import image_size
from ..intake import Found, Intrinsics, assemble
from ..photo_finder import PhotoFinder
from ..ply_points import read_ply_points

NAME = "transforms.json"
EXTENSIONS = (".json",)
PATTERNS = ("transforms_train.json", "transforms.json")

_LENS_OF_MODEL = {
    "PINHOLE": "pinhole",
    "SIMPLE_PINHOLE": "pinhole",
    "OPENCV": "opencv",
    "RADIAL": "opencv",
    "SIMPLE_RADIAL": "opencv",
    "FULL_OPENCV": "opencv",
    "PERSPECTIVE": "opencv",
    "OPENCV_FISHEYE": "opencv_fisheye",
}


def is_transforms(content: Any) -> bool:
    """True if parsed JSON looks like a transforms file."""
    return (
        isinstance(content, dict)
        and "frames" in content
        and not ("views" in content or "poses" in content)
    )


def recognises(file: Path) -> bool:
    """True for JSON with frames, also if it is cut off."""
    head = head_of(file, 1 << 20)
    return head.lstrip(b"\xef\xbb\xbf \r\n\t")[:1] == b"{" and (
        b'"frames"' in head or file.name.lower().startswith("transforms")
    )


def read(path: Path, photos: PhotoFinder) -> Capture:
    """Read a transforms file.

    Raises:
        CaptureError: anything that cannot be used, with file, field and remedy.
    """
    content = read_json(path)
    if not is_transforms(content):
        raise CaptureError(path, "frames", "there is no list of frames", "give a transforms.json")
    frames = content["frames"]
    if not isinstance(frames, list) or not frames:
        raise CaptureError(
            path, "frames", "the list of frames is empty", "export the cameras again"
        )
    found = []
    for index, frame in enumerate(frames):
        where = f"frames[{index}]"
        if not isinstance(frame, dict):
            raise CaptureError(path, where, "a frame must be an object", "export the file again")
        stated = frame.get("file_path")
        if not isinstance(stated, str) or not stated or "\0" in stated:
            raise CaptureError(
                path, f"{where}.file_path", "the frame names no photo", "add the photo's path"
            )
        photo = photos.find(stated, beside=path)
        intrinsics = mask = None
        if photo is not None:
            intrinsics = _intrinsics(path, where, {**content, **frame}, photo)
            mask = photos.mask_of(photo, frame.get("mask_path"), beside=path)
        found.append(
            Found(f"{where}.transform_matrix", stated, photo, frame.get("transform_matrix"),
                  intrinsics, mask)
        )  # fmt: skip
    points, warnings = _points(path, content.get("ply_file_path"))
    return assemble(path, NAME, found, photos, points=points, warnings=warnings)


def write_transforms(
    path: Path, cameras: list[Camera], extra: dict[str, Any] | None = None
) -> None:
    """Write cameras as a transforms file with intrinsics per frame; read back by `read`.

    Photos are named by the cameras' paths: where these are absolute, the file may stand anywhere on
    this machine.

    Args:
        extra: what else the file says, beside its frames.
    """
    frames = []
    for camera in cameras:
        frame: dict[str, Any] = {
            "file_path": str(camera.image_path),
            "name": camera.name,
            "transform_matrix": camera.camera_to_world.tolist(),
            "w": camera.width, "h": camera.height,
            "fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx, "cy": camera.cy,
            "camera_model": {v: k for k, v in reversed(_LENS_OF_MODEL.items())}[camera.lens],
        }  # fmt: skip
        if len(camera.distortion) > 5:
            frame["camera_model"] = "FULL_OPENCV"
        keys = _FISHEYE_KEYS if camera.lens == "opencv_fisheye" else _RATIONAL_KEYS
        frame.update(dict(zip(keys, camera.distortion, strict=False)))
        if camera.mask_path is not None:
            frame["mask_path"] = str(camera.mask_path)
        frames.append(frame)
    path.parent.mkdir(parents=True, exist_ok=True)
    content = {**(extra or {}), "frames": frames}
    path.write_text(json.dumps(content, indent=1, allow_nan=False), encoding="utf-8")


def _points(path: Path, stated: Any) -> tuple[np.ndarray | None, tuple[str, ...]]:
    """nerfstudio's sparse points, if the file has them beside it; a capture is complete without."""
    if not isinstance(stated, str) or not stated or "\0" in stated:
        return None, ()
    file = Path(os.path.normpath(path.parent / stated))
    if not file.is_relative_to(path.parent) or not file.is_file():
        return None, ()
    try:
        return read_ply_points(file), ()
    except CaptureError as error:
        return None, (f"{file.name}: {error.problem}, so it is left out",)


_OPENCV_KEYS = ("k1", "k2", "p1", "p2", "k3")
_RATIONAL_KEYS = (*_OPENCV_KEYS, "k4", "k5", "k6")
_FISHEYE_KEYS = ("k1", "k2", "k3", "k4")


def _number(path: Path, where: str, values: dict, key: str) -> float | None:
    value = values.get(key)
    if value is None:
        return None
    if isinstance(value, str):
        raise CaptureError(
            path, f"{where}.{key}", f"'{shown(value)}' is not a number", "correct the value"
        )
    return checked_number(path, f"{where}.{key}", value)


def _intrinsics(path: Path, where: str, values: dict, image: Path) -> Intrinsics:
    """Size, focal lengths, principal point and lens of a frame, its own values first."""

    def number(key: str) -> float | None:
        return _number(path, where, values, key)

    width, height = number("w"), number("h")
    if width is None or height is None:
        width, height = image_size(image)
    width, height = int(width), int(height)
    if width < 1 or height < 1:
        raise CaptureError(path, f"{where}.w", "the photo has no size", "correct w and h")
    fx, fy = number("fl_x"), number("fl_y")
    if fx is None:
        angle = number("camera_angle_x")
        if angle is None:
            raise CaptureError(
                path, "camera_angle_x", "the file gives neither camera_angle_x nor fl_x",
                "add the horizontal field of view in radians as camera_angle_x",
            )  # fmt: skip
        if not 0 < angle < math.pi:
            raise CaptureError(
                path, "camera_angle_x", f"{angle} is no field of view in radians",
                "give an angle between 0 and 3.14",
            )  # fmt: skip
        fx = 0.5 * width / math.tan(0.5 * angle)
        vertical = number("camera_angle_y")
        if fy is None and vertical is not None and 0 < vertical < math.pi:
            fy = 0.5 * height / math.tan(0.5 * vertical)
    fy = fx if fy is None else fy
    if fx <= 0 or fy <= 0:
        raise CaptureError(path, f"{where}.fl_x", "a focal length must be positive", "correct it")
    cx, cy = number("cx"), number("cy")
    lens, distortion = _lens(path, where, values)
    return Intrinsics(
        width, height, fx, fy, width / 2 if cx is None else cx, height / 2 if cy is None else cy,
        lens, distortion,
    )  # fmt: skip


def _lens(path: Path, where: str, values: dict) -> tuple[str, tuple[float, ...]]:
    model = values.get("camera_model")
    if values.get("is_fisheye") is True:
        model = "OPENCV_FISHEYE"
    lens = "opencv" if model is None else _LENS_OF_MODEL.get(str(model).upper())
    if lens is None:
        raise CaptureError(
            path, f"{where}.camera_model", f"the lens model '{model}' is not supported",
            f"use one of {', '.join(_LENS_OF_MODEL)}",
        )  # fmt: skip
    keys = _FISHEYE_KEYS if lens == "opencv_fisheye" else _OPENCV_KEYS
    if str(model).upper() == "FULL_OPENCV":
        keys = _RATIONAL_KEYS  # elsewhere a k4 may mean something else
    numbers = tuple(_number(path, where, values, key) or 0.0 for key in keys)
    if lens == "pinhole" or (lens == "opencv" and not any(numbers)):
        return "pinhole", ()
    return lens, numbers
