"""Sparse points where a capture has cameras but no points: what photos of one place have in common.

SIFT features (Lowe 2004, doi:10.1023/B:VISI.0000029664.99615.94) of photos taken near each other are
matched, verified and triangulated by COLMAP. Textured things get points, shiny and plain ones hardly any.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import Image

from ..job.apart import run_apart
from ..threads import usable_cores
from .camera import Camera
from .colour import linear_to_srgb
from .frames import invert_pose, opencv_from_opengl, pose_opencv_from_opengl
from .photos import Photo

LONGEST, MOST_ENLARGED = 800, 4
"""longer side, in pixels, at which features are found; small photos are enlarged, by so much at most, for
features are sought from some pixels' width on"""
MOST_FEATURES = 2048
NEIGHBOURS = 10
"""photos that each is compared with"""
WIDEST = np.radians(60)
"""angle between directions of view beyond which photos are not compared: features look different then"""
FEWEST_VIEWS = 3
"""photos that must agree on a point: two do by chance along an epipolar line"""
DATABASE = "database.db"
FEATURES_SHARE = 0.7
"""of the time, for the progress"""


class Features(NamedTuple):
    """What was found in a photo."""

    places: np.ndarray  # [N, 2] float32, pixels, without the lens's distortion
    descriptors: Any  # pycolmap's
    camera: Any  # pycolmap's: the pinhole whose pixels they are


def triangulate(
    cameras: list[Camera], photos: list[Photo], progress: Callable[[float], None]
) -> np.ndarray:
    """World points [N, 3] on what at least `FEWEST_VIEWS` photos see alike; maybe none.

    Args:
        cameras: of the photos, in their order; any lens.
        progress: told the share done, several times a second; what it raises ends the work.

    Raises:
        ApartError: COLMAP cannot do it.
    """
    if len(cameras) < FEWEST_VIEWS:
        return np.zeros((0, 3))
    pictures = [_grey(photo) for photo in photos]
    with tempfile.TemporaryDirectory(prefix="nmf-points-") as folder:
        # In one process, COLMAP's and torch's OpenMP runtimes end Python on macOS.
        return run_apart(with_colmap, Path(folder), cameras, pictures, progress=progress)


def with_colmap(
    folder: Path, cameras: list[Camera], pictures: list[np.ndarray],
    progress: Callable[[float], None],
) -> np.ndarray:  # fmt: skip
    """As `triangulate`, of grey pictures [H, W] uint8, in this process and an empty folder."""
    import pycolmap

    pycolmap.logging.minloglevel = int(pycolmap.logging.FATAL)
    pycolmap.set_random_seed(0)
    features = _features(pycolmap, cameras, pictures, progress)
    model = _register(pycolmap, folder / DATABASE, cameras, features)
    _match(pycolmap, folder, neighbours(cameras), progress)
    options = pycolmap.IncrementalPipelineOptions()
    options.extract_colors, options.num_threads = False, usable_cores()
    options.random_seed = options.triangulation.random_seed = 0
    found = pycolmap.triangulate_points(model, folder / DATABASE, folder, folder, True, options)
    progress(1.0)
    points = [p.xyz for p in found.points3D.values() if p.track.length() >= FEWEST_VIEWS]
    return np.array(points, dtype=np.float64).reshape(-1, 3)


def neighbours(cameras: list[Camera]) -> list[tuple[int, int]]:
    """Pairs (i < j) of cameras that look alike from nearby, up to about `NEIGHBOURS` each."""
    positions = np.stack([camera.position for camera in cameras])
    axes = np.stack([camera.view_direction for camera in cameras])
    pairs = set()
    for index, (position, axis) in enumerate(zip(positions, axes, strict=True)):
        angle = np.arccos(np.clip(axes @ axis, -1, 1))
        away = np.linalg.norm(positions - position, axis=1)
        # What two photos have in common is lost by turning away as by walking away.
        cost = away / max(np.median(away), 1e-12) + angle / WIDEST
        cost[index] = np.inf
        near = [int(j) for j in np.argsort(cost)[:NEIGHBOURS] if angle[j] < WIDEST and j != index]
        pairs |= {(min(index, j), max(index, j)) for j in near}
    return sorted(pairs)


def _features(
    colmap: Any, cameras: list[Camera], pictures: list[np.ndarray],
    progress: Callable[[float], None],
) -> list[Features]:  # fmt: skip
    options = colmap.FeatureExtractionOptions()
    options.num_threads, options.use_gpu = 1, False
    options.sift.max_num_features, options.sift.first_octave = MOST_FEATURES, 0

    def find(camera: Camera, grey: np.ndarray) -> Features:
        extractor = colmap.FeatureExtractor.create(options, colmap.Device.cpu)
        keypoints, descriptors = extractor.extract_from_uint8_array(grey)
        places = np.array([(k.x, k.y) for k in keypoints]).reshape(-1, 2)
        height, width = grey.shape
        scale = np.array([width / camera.width, height / camera.height])
        local = opencv_from_opengl(
            camera.rays(*(places / scale).T)[1] @ camera.camera_to_world[:3, :3]
        )
        # A pinhole has no place for what a fisheye sees beside itself: far outside, it fits no match.
        flat = local[:, :2] / np.maximum(local[:, 2:], 1e-2)
        focal, centre = scale * (camera.fx, camera.fy), scale * (camera.cx, camera.cy)
        pinhole = colmap.Camera(
            model="PINHOLE", width=width, height=height, params=[*focal, *centre]
        )
        return Features((flat * focal + centre).astype(np.float32), descriptors, pinhole)

    found = []
    with ThreadPoolExecutor(max_workers=usable_cores()) as pool:
        for features in pool.map(find, cameras, pictures):
            found.append(features)
            progress(FEATURES_SHARE * len(found) / len(pictures))
    return found


def _grey(photo: Photo) -> np.ndarray:
    """A photo as people see it, grey, [H, W] uint8, about `LONGEST`; with alpha over white."""
    height, width = photo.pixels.shape[:2]
    factor = min(LONGEST / max(height, width), MOST_ENLARGED)
    size = max(1, round(factor * width)), max(1, round(factor * height))
    alpha = photo.pixels[..., 3:]
    straight = photo.pixels[..., :3] / np.maximum(alpha, 1e-4)
    shown = np.clip(linear_to_srgb(straight), 0, 1) * alpha + 1 - alpha
    picture = Image.fromarray((255 * shown + 0.5).astype(np.uint8)).convert("L")
    return np.array(picture.resize(size, Image.Resampling.LANCZOS))


def _register(colmap: Any, path: Path, cameras: list[Camera], features: list[Features]) -> Any:
    """Put all into a new database; a model of the cameras at their known poses."""
    model = colmap.Reconstruction()
    database = colmap.Database.open(path)
    try:
        with colmap.DatabaseTransaction(database):
            for index, (camera, found) in enumerate(zip(cameras, features, strict=True)):
                pinhole = found.camera
                pinhole.camera_id = database.write_camera(pinhole)
                rig = colmap.Rig(rig_id=pinhole.camera_id)
                rig.add_ref_sensor(pinhole.sensor_id)
                database.write_rig(rig)
                image = colmap.Image(name=_name(index), camera_id=pinhole.camera_id)
                number = database.write_image(image)
                frame = colmap.Frame(frame_id=number, rig_id=rig.rig_id)
                frame.add_data_id(colmap.data_t(pinhole.sensor_id, number))
                database.write_frame(frame)
                database.write_keypoints(number, found.places)
                database.write_descriptors(number, found.descriptors)
                pose = colmap.Rigid3d(
                    invert_pose(pose_opencv_from_opengl(camera.camera_to_world))[:3]
                )
                image.image_id = number
                model.add_camera_with_trivial_rig(pinhole)
                model.add_image_with_trivial_frame(image, pose)
    finally:
        database.close()
    return model


def _match(
    colmap: Any, folder: Path, pairs: list[tuple[int, int]], progress: Callable[[float], None]
) -> None:
    """Matches of all pairs, verified, in blocks of about a second."""
    matching = colmap.FeatureMatchingOptions()
    matching.num_threads, matching.use_gpu = usable_cores(), False
    verification = colmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = 0
    listing = folder / "pairs.txt"
    block = 20 * usable_cores()
    for first in range(0, len(pairs), block):
        progress(FEATURES_SHARE + (1 - FEATURES_SHARE) * first / len(pairs))
        lines = (f"{_name(i)} {_name(j)}\n" for i, j in pairs[first : first + block])
        listing.write_text("".join(lines), encoding="ascii")
        colmap.match_image_pairs(
            folder / DATABASE, matching_options=matching,
            pairing_options=colmap.ImportedPairingOptions(match_list_path=listing),
            verification_options=verification, device=colmap.Device.cpu,
        )  # fmt: skip


def _name(index: int) -> str:
    return f"{index:06d}.png"
