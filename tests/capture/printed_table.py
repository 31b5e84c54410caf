"""Photos of a printed table in the dark, from cameras on an arc above it."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy.ndimage
from PIL import Image
from scipy.spatial.transform import Rotation

from solver.capture.camera import Camera
from solver.capture.formats.transforms import write_transforms
from solver.capture.frames import pose_opengl_from_opencv
from solver.capture.photo_matches import picture_of
from solver.capture.photos import Photo, linear_to_srgb, srgb_to_linear

WIDTH, HEIGHT = 240, 180
TEXEL = 0.01
FAR_AND_WIDE = 2400
"""texels of a table that fills every photo"""
LENSES = {
    "pinhole": (),
    "opencv": (-0.15, 0.04, 0.002, -0.001),
    "opencv_fisheye": (0.03, -0.01, 0.0, 0.0),
}


def camera_at(angle, lens="pinhole", height=1.6):
    """A camera on a circle above the table that looks at its middle."""
    position = np.array([2.2 * math.cos(angle), 2.2 * math.sin(angle), height])
    forward = -position / np.linalg.norm(position)
    right = np.cross(forward, (0, 0, 1))
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = position
    return Camera(
        f"c{angle:.2f}", None, pose_opengl_from_opencv(pose), WIDTH, HEIGHT, 260.0, 255.0, 124.0,
        87.0, lens, LENSES[lens],
    )  # fmt: skip


def photo_of(camera, pattern):
    """What the camera sees of a printed table in the dark, z = 0, a hundredth of a unit to a texel."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    origins, directions = camera.rays(columns.ravel(), rows.ravel())
    place = origins - directions * (origins[:, 2:] / directions[:, 2:])
    at = place[:, :2] / TEXEL + 0.5 * len(pattern) - 0.5
    seen = scipy.ndimage.map_coordinates(pattern, at.T, order=1, cval=0.0)
    pixels = np.repeat(srgb_to_linear(seen)[:, None], 3, axis=1)
    pixels = np.concatenate([pixels, np.ones_like(pixels[:, :1])], axis=1)
    return Photo(pixels.reshape(HEIGHT, WIDTH, 4).astype(np.float32), False, False)


def picture_at(camera, pattern):
    """The same as a picture in which features are sought."""
    return picture_of(photo_of(camera, pattern))


def printed(size=300):
    """A pattern [size, size] with something to find everywhere."""
    rough = np.random.default_rng(3).random((size, size))
    smooth = scipy.ndimage.gaussian_filter(rough, 1.5)
    return np.clip(0.5 + (smooth - 0.5) * 4, 0, 1)


def write_table(folder, cameras, told=None):
    """A capture of photos of a wide table from the cameras, or from those that its file tells of; returns
    that."""
    named, pattern = [], printed(FAR_AND_WIDE)
    for camera, pose in zip(cameras, told or cameras, strict=True):
        pixels = linear_to_srgb(photo_of(camera, pattern).pixels[..., :3])
        path = folder / f"{camera.name}.png"
        Image.fromarray((255 * np.clip(pixels, 0, 1) + 0.5).astype(np.uint8)).save(path)
        named.append(replace(pose, image_path=Path(path.name)))
    write_transforms(folder / "transforms.json", named)
    return folder / "transforms.json"


def shaken(cameras, degrees, share, seed=0):
    """Cameras turned by about so much and moved by a share of their way from the table, each by chance."""
    rng = np.random.default_rng(seed)
    moved = []
    for camera in cameras:
        pose = camera.camera_to_world.copy()
        turn = Rotation.from_rotvec(np.radians(degrees) * rng.normal(size=3) / np.sqrt(3))
        pose[:3, :3] = turn.as_matrix() @ pose[:3, :3]
        far = np.linalg.norm(camera.position)
        pose[:3, 3] += share * far * rng.normal(size=3) / np.sqrt(3)
        moved.append(replace(camera, camera_to_world=pose))
    return moved
