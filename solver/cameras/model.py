"""COLMAP's model, brought from the working size to the photos' and into an upright world."""

import re
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from ..capture.camera import Camera
from ..capture.capture import Capture, region_seen_by
from ..capture.errors import CaptureError
from ..capture.formats.colmap_model import Sensor, intrinsics_of
from ..capture.frames import pose_of_opencv, scale_and_rotation
from ..capture.placement import placed as moved_capture
from ..capture.placement import suggest_placement
from ..capture.reduced import load_reduced
from .folder import SolveFolder
from .output import write_points
from .prepare import Prepared

_COLOUR_SIZE = 400


def finish_model(
    colmap: Any, model: Any, photos: list[Prepared], folder: SolveFolder
) -> tuple[list[Camera], int]:
    """Change the model in place, write it and its points; cameras in the photos' order, and how many
    points there are.

    Args:
        colmap: the module. model: its `Reconstruction`, as the database names and sizes photos.
        folder: the working directory.
    """
    by_file = {photo.file: photo for photo in photos}
    placed = sorted(
        ((by_file[image.name], image) for image in model.images.values() if image.has_pose),
        key=lambda pair: pair[0].number,
    )
    colours = _colours(placed)
    _to_full_size(model, by_file)
    cameras = [_camera(photo, image) for photo, image in placed]
    capture = Capture(folder.cameras_path, tuple(cameras), region_seen_by(cameras))
    matrix = suggest_placement(capture)
    scale, rotation = scale_and_rotation(matrix)
    model.transform(colmap.Sim3d(scale, colmap.Rotation3d(rotation), matrix[:3, 3]))
    points = dict(model.points3D.items())
    for number, point in points.items():
        point.color = np.array(colours.get(number, (128, 128, 128)), dtype=np.uint8)
    target = folder.sparse_dir / "0"
    target.mkdir(parents=True, exist_ok=True)
    model.write_binary(target.relative_to(folder.root))
    write_points(
        folder.points_path,
        np.array([point.xyz for point in points.values()]).reshape(-1, 3),
        np.array([point.color for point in points.values()]).reshape(-1, 3),
    )
    return list(moved_capture(capture, matrix).cameras), len(points)


def _to_full_size(model: Any, by_file: dict[str, Prepared]) -> None:
    """Names, sizes, lenses and feature positions of the photos as they are."""
    sizes: dict[int, tuple[int, int]] = {}
    for image in model.images.values():
        photo = by_file[image.name]
        factor = np.array([photo.width / photo.small_width, photo.height / photo.small_height])
        for point in image.points2D:
            point.xy = point.xy * factor
        sizes[image.camera_id] = (photo.width, photo.height)
        image.name = photo.name
    for number, (width, height) in sizes.items():
        model.camera(number).rescale(width, height)


def _camera(photo: Prepared, image: Any) -> Camera:
    model, numbers = image.camera.model_name, tuple(float(v) for v in image.camera.params)
    lens = intrinsics_of(photo.path, Sensor("lens", model, photo.width, photo.height, numbers))
    if not np.isfinite(numbers).all() or min(lens.fx, lens.fy) <= 0:
        remedy = "set Lens Model to Simple Radial (--camera-model SIMPLE_RADIAL)"
        if model in ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL"):
            remedy = "take more photos, from more sides"
        raise CaptureError(photo.path, "lens", "the lens could not be solved from these photos", remedy)
    pose = pose_of_opencv(np.vstack([image.cam_from_world().matrix(), (0, 0, 0, 1)]))
    name = re.sub(r"[^\w.\-]+", "_", photo.name.rpartition(".")[0]).strip("._") or "photo"
    return Camera(name, photo.path, pose, ignored_path=photo.ignored, **vars(lens))


def _colours(placed: list[tuple[Prepared, Any]]) -> dict[int, np.ndarray]:
    """Mean sRGB colour [3] of every point, over the photos that show it."""

    def look(pair: tuple[Prepared, Any]) -> list[tuple[int, np.ndarray]]:
        photo, image = pair
        pixels, _ = load_reduced(photo.path, _COLOUR_SIZE)
        seen = [point for point in image.points2D if point.has_point3D()]
        if not seen:
            return []
        size = np.array([photo.small_width, photo.small_height])
        at = np.array([point.xy for point in seen]) / size * pixels.shape[1::-1]
        column, row = np.clip(at.astype(int), 0, np.array(pixels.shape[1::-1]) - 1).T
        return list(zip((p.point3D_id for p in seen), pixels[row, column], strict=True))

    total: dict[int, np.ndarray] = {}
    with ThreadPoolExecutor(max_workers=4) as pool:
        for found in pool.map(look, placed):
            for number, colour in found:
                total.setdefault(number, np.zeros(4))[:] += (*colour, 1)
    return {number: value[:3] / value[3] for number, value in total.items()}
