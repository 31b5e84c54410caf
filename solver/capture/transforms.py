"""`transforms.json`: the camera file of NeRF-synthetic, instant-ngp and nerfstudio.

All three give camera-to-world matrices with OpenGL camera axes. Intrinsics come as `camera_angle_x`
or `fl_x` (pixels), for all frames or for each; lens distortion as OpenCV's k1 k2 p1 p2. nerfstudio's
`applied_transform` says how the poses were moved before writing; the world is taken as written.
"""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np

from .camera import Camera
from .capture import Capture, region_seen_by
from .errors import CaptureError
from .image_header import EXTENSIONS, image_size

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
MIN_CAMERAS = 3


def is_transforms(content: Any) -> bool:
    """True if parsed JSON looks like a transforms file."""
    return isinstance(content, dict) and "frames" in content


def read_json(path: Path) -> Any:
    """Parsed JSON of a file, with errors a person can act on."""
    try:
        return json.loads(path.read_text(encoding="utf-8-sig"))
    except json.JSONDecodeError as error:
        raise CaptureError(
            path, f"line {error.lineno}", f"this is not valid JSON ({error.msg})",
            "the file seems cut off or edited; export it again",
        ) from error  # fmt: skip
    except UnicodeDecodeError as error:
        raise CaptureError(path, "", "this is not a text file", "give a camera file") from error
    except RecursionError as error:
        raise CaptureError(path, "", "its JSON is nested too deeply", "export it again") from error
    except OSError as error:
        raise CaptureError(
            path, "", f"it cannot be read ({error.strerror})", "check the path and its permissions"
        ) from error


def read_transforms(path: Path) -> Capture:
    """Read a transforms file.

    Frames whose photo is missing are left out with a warning, as long as half of them and at least
    three are there.

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
    cameras: list[Camera] = []
    missing: list[str] = []
    names: set[str] = set()
    for index, frame in enumerate(frames):
        where = f"frames[{index}]"
        if not isinstance(frame, dict):
            raise CaptureError(path, where, "a frame must be an object", "export the file again")
        image = _image_path(path, where, frame)
        if image is None:
            missing.append(str(frame["file_path"]))
            continue
        pose = _pose(path, f"{where}.transform_matrix", frame.get("transform_matrix"))
        mask = frame.get("mask_path")
        name = _unique_name(Path(str(frame["file_path"])).name, names)
        cameras.append(
            Camera(
                name=name, image_path=image, camera_to_world=pose,
                mask_path=path.parent / mask if isinstance(mask, str) else None,
                **_intrinsics(path, where, {**content, **frame}, image),
            )
        )  # fmt: skip
    if len(cameras) < MIN_CAMERAS or len(missing) > len(cameras):
        if missing:
            raise CaptureError(
                path, "frames", f"{len(missing)} of {len(frames)} photos are missing, "
                f"the first is '{missing[0]}'", f"put the photos below {path.parent}",
            )  # fmt: skip
        raise CaptureError(
            path, "frames", f"there are only {len(cameras)} cameras",
            f"a reconstruction needs at least {MIN_CAMERAS}, better 50",
        )  # fmt: skip
    warnings = list(_same_places(cameras))
    if missing:
        warnings.insert(0, f"{path.name}: {len(missing)} of {len(frames)} listed photos do not "
                        f"exist and are left out (the first: {missing[0]})")  # fmt: skip
    return Capture(path, tuple(cameras), region_seen_by(cameras), tuple(warnings))


def write_transforms(path: Path, cameras: list[Camera]) -> None:
    """Write cameras as a transforms file with intrinsics per frame; read back by `read_transforms`.

    Photos are named by absolute paths, so the file may stand anywhere on this machine.
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
    path.write_text(json.dumps({"frames": frames}, indent=1, allow_nan=False), encoding="utf-8")


_OPENCV_KEYS = ("k1", "k2", "p1", "p2", "k3")
_RATIONAL_KEYS = (*_OPENCV_KEYS, "k4", "k5", "k6")
_FISHEYE_KEYS = ("k1", "k2", "k3", "k4")


def _image_path(path: Path, where: str, frame: dict) -> Path | None:
    """The photo of a frame; None if it does not exist."""
    text = frame.get("file_path")
    if not isinstance(text, str) or not text or "\0" in text:
        raise CaptureError(
            path, f"{where}.file_path", "the frame names no photo", "add the photo's path"
        )
    stated = path.parent / text
    candidates = [stated] + [stated.with_name(stated.name + ext) for ext in EXTENSIONS]
    try:
        return next((c for c in candidates if c.suffix.lower() in EXTENSIONS and c.is_file()), None)
    except OSError:
        return None


def _pose(path: Path, field: str, value: Any) -> np.ndarray:
    """A rigid [4, 4] camera-to-world matrix; a uniform scale of the camera's axes is dropped."""
    remedy = "solve or export the cameras again"
    try:
        matrix = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        matrix = np.zeros(0)
    if matrix.shape not in ((4, 4), (3, 4)):
        raise CaptureError(path, field, "a pose must be a 4 × 4 matrix of numbers", remedy)
    if not np.isfinite(matrix).all():
        raise CaptureError(path, field, "the pose holds a value that is not a number", remedy)
    u, scale, vt = np.linalg.svd(matrix[:3, :3])
    if scale[2] < 1e-6 * max(scale[0], 1e-12):
        raise CaptureError(path, field, "the pose's rotation is singular", remedy)
    if scale[0] > 1.02 * scale[2]:
        raise CaptureError(path, field, "the pose's axes are not at right angles", remedy)
    if np.linalg.det(matrix[:3, :3]) < 0:
        raise CaptureError(path, field, "the pose mirrors the world", remedy)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = u @ vt, matrix[:3, 3]
    return pose


def _number(path: Path, where: str, values: dict, key: str) -> float | None:
    value = values.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise CaptureError(
            path, f"{where}.{key}", f"'{value}' is not a number", "correct the value"
        )
    return float(value)


def _intrinsics(path: Path, where: str, values: dict, image: Path) -> dict[str, Any]:
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
    return {
        "width": width, "height": height, "fx": fx, "fy": fy,
        "cx": width / 2 if cx is None else cx, "cy": height / 2 if cy is None else cy,
        "lens": lens, "distortion": distortion,
    }  # fmt: skip


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


def _unique_name(file_name: str, taken: set[str]) -> str:
    """A name for output files: the photo's stem, numbered if it is taken."""
    stem = file_name
    for extension in EXTENSIONS:
        if stem.lower().endswith(extension):
            stem = stem[: -len(extension)]
    stem = re.sub(r"[^\w.\-]+", "_", stem).strip("._") or "photo"
    name, number = stem, 2
    while name.lower() in taken:
        name, number = f"{stem}_{number}", number + 1
    taken.add(name.lower())
    return name


def _same_places(cameras: list[Camera]):
    """Warnings for cameras with one pose."""
    seen: dict[bytes, str] = {}
    for camera in cameras:
        key = np.round(camera.camera_to_world, 6).tobytes()
        if key in seen:
            yield f"{camera.name} and {seen[key]} have the same pose"
        seen[key] = camera.name
