"""A camera with its photo: pose, intrinsics, lens distortion; pixels to rays and back.

World: right-handed, +Z up. Camera axes are OpenGL's and Blender's: +X right, +Y up, the view along
−Z. Pixel coordinates are (column, row) with row 0 on top and pixel centres at +0.5.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

LENSES = ("pinhole", "opencv", "opencv_fisheye")
_NEWTON_STEPS = 20


@dataclass(frozen=True, eq=False)
class Camera:
    """One photo's camera.

    Attributes:
        name: unique, safe as a file name; outputs are named after it.
        camera_to_world: [4, 4] double, a rotation and a translation in world units.
        fx, fy, cx, cy: focal lengths and principal point in pixels.
        lens: one of `LENSES`.
        distortion: OpenCV's k1 k2 p1 p2 k3 (`opencv`) or k1 k2 k3 k4 (`opencv_fisheye`).
    """

    name: str
    image_path: Path | None
    camera_to_world: np.ndarray
    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    lens: str = "pinhole"
    distortion: tuple[float, ...] = ()
    mask_path: Path | None = None

    @property
    def position(self) -> np.ndarray:
        """World position [3]."""
        return self.camera_to_world[:3, 3]

    @property
    def view_direction(self) -> np.ndarray:
        """Unit world direction [3] of the optical axis."""
        return -self.camera_to_world[:3, 2]

    def rays(self, columns: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """World origins and unit directions [N, 3] through pixel positions [N]."""
        x = (np.asarray(columns, dtype=np.float64) - self.cx) / self.fx
        y = (np.asarray(rows, dtype=np.float64) - self.cy) / self.fy
        x, y, z = self._undistort(x, y)
        local = np.stack([x, -y, -z], axis=-1)
        local /= np.linalg.norm(local, axis=-1, keepdims=True)
        directions = local @ self.camera_to_world[:3, :3].T
        return np.broadcast_to(self.position, directions.shape).copy(), directions

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixel positions [N, 2] (column, row) and depths [N] of world points [N, 3].

        Depth is the distance along the optical axis; where it is not positive the pixel is NaN.
        """
        local = (np.asarray(points, dtype=np.float64) - self.position) @ self.camera_to_world[
            :3, :3
        ]
        depth = -local[:, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            x = np.where(depth > 0, local[:, 0] / depth, np.nan)
            y = np.where(depth > 0, -local[:, 1] / depth, np.nan)
        x, y = self._distort(x, y)
        return np.stack([x * self.fx + self.cx, y * self.fy + self.cy], axis=-1), depth

    def _distort(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Ideal to distorted image coordinates (OpenCV's definitions)."""
        if self.lens == "opencv":
            k1, k2, p1, p2, k3 = (*self.distortion, 0, 0, 0, 0, 0)[:5]
            r2 = x * x + y * y
            radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
            return (
                x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
                y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
            )
        if self.lens == "opencv_fisheye":
            r = np.hypot(x, y)
            scale = np.where(r > 1e-9, self._fisheye_radius(np.arctan(r)) / np.maximum(r, 1e-9), 1)
            return x * scale, y * scale
        return x, y

    def _fisheye_radius(self, theta: np.ndarray) -> np.ndarray:
        k1, k2, k3, k4 = (*self.distortion, 0, 0, 0, 0)[:4]
        t2 = theta * theta
        return theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))

    def _undistort(
        self, xd: np.ndarray, yd: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Direction (x right, y down, z forward) whose distorted image is (xd, yd), by Newton."""
        if self.lens == "opencv" and any(self.distortion):
            x, y = xd.copy(), yd.copy()
            h = 1e-6
            for _ in range(_NEWTON_STEPS):
                u, v = self._distort(x, y)
                ux, vx = self._distort(x + h, y)
                uy, vy = self._distort(x, y + h)
                a, b, c, d = (ux - u) / h, (uy - u) / h, (vx - v) / h, (vy - v) / h
                determinant = a * d - b * c
                determinant = np.where(np.abs(determinant) < 1e-9, 1e-9, determinant)
                x -= (d * (u - xd) - b * (v - yd)) / determinant
                y -= (a * (v - yd) - c * (u - xd)) / determinant
            return x, y, np.ones_like(x)
        if self.lens == "opencv_fisheye":
            radius = np.hypot(xd, yd)
            theta = radius.copy()
            for _ in range(_NEWTON_STEPS):
                slope = (self._fisheye_radius(theta + 1e-6) - self._fisheye_radius(theta)) / 1e-6
                theta -= (self._fisheye_radius(theta) - radius) / np.maximum(slope, 1e-6)
            scale = np.where(radius > 1e-12, np.sin(theta) / np.maximum(radius, 1e-12), 1.0)
            return xd * scale, yd * scale, np.cos(theta)
        return xd, yd, np.ones_like(xd)
