"""Poses of cameras that look at something, and worlds they may be in."""

import numpy as np
from scipy.spatial.transform import Rotation

from solver.capture.camera import Camera


def look_at(position, roll=0.0, target=(0, 0, 0)):
    back = np.array(position, dtype=float) - target
    back /= np.linalg.norm(back)
    right = np.cross((0, 0, 1), back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3] = np.stack([right, np.cross(back, right), back, position], 1)
    matrix[:3, :3] = matrix[:3, :3] @ Rotation.from_euler("z", roll).as_matrix()
    return matrix


def camera_at(pose, name="c"):
    """A camera without a photo."""
    return Camera(name, None, pose, 60, 40, 70.0, 70.0, 30.0, 20.0)


def ring(count=24, heights=(0.3, 1.2), roll=lambda i: 0.0):
    cameras = []
    for i in range(count):
        angle = 2 * np.pi * i / count
        height = heights[i % len(heights)]
        pose = look_at((3 * np.cos(angle), 3 * np.sin(angle), height), roll(i))
        cameras.append(camera_at(pose, f"c{i}"))
    return cameras


def similarity(seed):
    rng = np.random.default_rng(seed)
    matrix = np.eye(4)
    matrix[:3, :3] = rng.uniform(0.1, 30) * Rotation.random(random_state=seed).as_matrix()
    matrix[:3, 3] = rng.normal(size=3) * 50
    return matrix
