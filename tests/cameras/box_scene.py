"""Photos with exact cameras: a textured box on a textured floor, cast ray by ray."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import scipy.ndimage
from PIL import Image

from solver.capture.camera import Camera

WIDTH, HEIGHT, FOCAL = 480, 360, 520.0
HALF = np.array([0.5, 0.4, 0.45])
"""half edges of the box, which stands on z = 0"""


def _texture(seed: int, size: int = 512) -> np.ndarray:
    """Spots of many sizes with sharp edges [size, size] in [0, 1], as a feature detector likes them."""
    random = np.random.default_rng(seed)
    total = np.zeros((size, size))
    for width, weight in ((4, 0.6), (10, 0.6), (25, 0.4)):
        noise = scipy.ndimage.gaussian_filter(random.normal(size=(size, size)), width, mode="wrap")
        total += weight * noise / noise.std()
    return np.clip(0.55 + 0.13 * np.round(total), 0, 1).astype(np.float32)


def look_at(position: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Camera to world [4, 4], OpenGL axes, +Z up."""
    back = position - target
    back = back / np.linalg.norm(back)
    right = np.cross((0, 0, 1), back)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(back, right), back, position], axis=1)
    return pose


def orbit(count: int = 14, degrees: float = 200.0, distance: float = 2.6) -> list[np.ndarray]:
    """Poses [4, 4] on an arc around the box, at alternating heights."""
    poses = []
    for i in range(count):
        angle = math.radians(degrees * i / (count - 1))
        height = 0.9 if i % 2 else 1.3
        position = np.array([distance * math.cos(angle), distance * math.sin(angle), height])
        poses.append(look_at(position, np.array([0.0, 0.0, 0.35])))
    return poses


def box_camera(pose: np.ndarray, name: str = "c", path: Path | None = None, scale: float = 1.0):
    """A pinhole camera of the scene's photos."""
    width, height = round(WIDTH * scale), round(HEIGHT * scale)
    return Camera(name, path, pose, width, height, FOCAL * scale, FOCAL * scale, width / 2, height / 2)


class BoxScene:
    """The box and its floor; `photo` casts two rays by two a pixel."""

    # axis, where on it, which tint: the floor, the box's sides, its top
    PLANES = [(2, 0.0), (0, -HALF[0]), (0, HALF[0]), (1, -HALF[1]), (1, HALF[1]), (2, 2 * HALF[2])]
    REACH = 9.0

    def __init__(self):
        self.textures = [_texture(seed) for seed in range(len(self.PLANES))]
        self.tints = np.random.default_rng(9).uniform(0.85, 1.0, (len(self.PLANES), 3))

    def photo(self, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
        """Colours [H, W, 3] uint8 and where the box is [H, W] bool."""
        row, column = np.mgrid[0 : 2 * camera.height, 0 : 2 * camera.width] / 2 + 0.25
        origins, direction = camera.rays(column.ravel(), row.ravel())
        origin = origins[0]
        colour = np.full(direction.shape, 0.6, np.float32)
        nearest = np.full(len(direction), np.inf)
        on_box = np.zeros(len(direction), bool)
        middle = np.array([0, 0, HALF[2]])
        for index, (axis, at) in enumerate(self.PLANES):
            others = [other for other in range(3) if other != axis]
            with np.errstate(divide="ignore"):
                distance = (at - origin[axis]) / direction[:, axis]
            maybe = np.flatnonzero((distance > 0) & (distance < nearest) & (distance < self.REACH))
            local = origin[others] + distance[maybe, None] * direction[maybe][:, others]
            if index:
                inside = (np.abs(local - middle[others]) <= HALF[others]).all(axis=1)
                maybe, local = maybe[inside], local[inside]
            nearest[maybe], on_box[maybe] = distance[maybe], index > 0
            texel = (local * (200 if index else 110)).T
            value = scipy.ndimage.map_coordinates(self.textures[index], texel, order=1, mode="wrap")
            colour[maybe] = value[:, None] * self.tints[index]
        shape = (camera.height, 2, camera.width, 2)
        colour = colour.reshape(*shape, 3).mean(axis=(1, 3))
        return np.round(colour * 255).astype(np.uint8), on_box.reshape(shape).mean((1, 3)) > 0.5


def write_photos(folder: Path, poses: list[np.ndarray], scale: float = 1.0) -> list[Camera]:
    """Photos IMG_000.jpg, … below a folder; returns their true cameras."""
    folder.mkdir(parents=True, exist_ok=True)
    scene, cameras = BoxScene(), []
    for index, pose in enumerate(poses):
        path = folder / f"IMG_{index:03d}.jpg"
        camera = box_camera(pose, path.stem, path, scale)
        Image.fromarray(scene.photo(camera)[0]).save(path, quality=95)
        cameras.append(camera)
    return cameras


def align(found: np.ndarray, truth: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Scale, rotation [3, 3] and translation that bring points [N, 3] to others (Umeyama, 1991)."""
    a, b = found - found.mean(0), truth - truth.mean(0)
    u, s, vt = np.linalg.svd(b.T @ a)
    flip = np.diag([1.0, 1.0, np.linalg.det(u @ vt)])
    rotation, scale = u @ flip @ vt, (s * np.diag(flip)).sum() / (a**2).sum()
    return scale, rotation, truth.mean(0) - scale * rotation @ found.mean(0)
