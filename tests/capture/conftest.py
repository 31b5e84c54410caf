"""Solved models with photos, made with COLMAP itself."""

import math

import numpy as np
import pytest
from PIL import Image

# isort: split
# pycolmap brings a zlib of its own: if that is loaded before Pillow's, saving a photo crashes Python.
import pycolmap

WIDTH, HEIGHT = 64, 48


def cam_from_world(angle, distance=4.0):
    """A camera on a circle that looks at the origin, as COLMAP has it."""
    forward = -np.array([math.cos(angle), math.sin(angle), 0.3])
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, (0, 0, 1))
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return pycolmap.Rigid3d(pycolmap.Rotation3d(rotation), rotation @ forward * distance)


def save_photo(file, seed=0):
    file.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", (WIDTH, HEIGHT), (seed % 256, 90, 120)).save(file)


@pytest.fixture(scope="session")
def solved():
    """A function that makes a reconstruction of so many photos with a camera model each."""

    def make(photos, model="PINHOLE", parameters=(70, 60, 30, 25), names=None, points=150):
        names = names or [f"r_{i}.png" for i in range(5)]
        reconstruction = pycolmap.Reconstruction()
        reconstruction.add_camera_with_trivial_rig(
            pycolmap.Camera(camera_id=1, model=model, width=WIDTH, height=HEIGHT, params=list(parameters))
        )
        for index, name in enumerate(names):
            image = pycolmap.Image(name=name, camera_id=1, image_id=index + 1)
            reconstruction.add_image_with_trivial_frame(image, cam_from_world(0.9 * index))
            save_photo(photos / name, index)
        generator = np.random.default_rng(0)
        for xyz in generator.uniform(-0.9, 0.9, (points, 3)):
            reconstruction.add_point3D(xyz, pycolmap.Track(), np.array([9, 9, 9], np.uint8))
        return reconstruction

    return make


@pytest.fixture(scope="session")
def agrees():
    """A function that compares a capture's cameras with COLMAP's projections of its points.

    Returns how many projections were compared.
    """

    def compare(capture, reconstruction, photos, tolerance=1e-6):
        images = {image.name: image for image in reconstruction.images.values()}
        points = np.array([point.xyz for point in reconstruction.points3D.values()])
        compared = 0
        for camera in capture.cameras:
            image = images[camera.image_path.relative_to(photos).as_posix()]
            expected = [image.project_point(point) for point in points]
            seen = np.array([pixel is not None for pixel in expected])
            expected = np.array([pixel for pixel in expected if pixel is not None])
            pixels, _ = camera.project(points[seen])
            np.testing.assert_allclose(pixels, expected, rtol=0, atol=tolerance)
            origins, directions = camera.rays(*expected.T)
            along = points[seen] - origins
            along /= np.linalg.norm(along, axis=1, keepdims=True)
            np.testing.assert_allclose(directions, along, atol=1e-8)
            compared += len(expected)
        return compared

    return compare
