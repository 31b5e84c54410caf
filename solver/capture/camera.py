"""A camera with its photo: pose, intrinsics, lens distortion; pixels to rays and back.

World, camera axes and pixels are as `frames` has them.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .frames import opencv_from_opengl, opengl_from_opencv, rigid, scale_and_rotation, unit
from .lens_solve import Numbers, Pair
from .lenses import distort, undistort
from .panoramic_lens import PANORAMIC


@dataclass(frozen=True, eq=False)
class Camera:
    """One photo's camera.

    Attributes:
        name: unique, safe as a file name; outputs are named after it.
        image_path: the photo; None for a camera that only renders.
        camera_to_world: [4, 4] double, a rotation and a translation in world units.
        fx, fy, cx, cy: focal lengths and principal point in pixels; of a panorama pixels per radian.
        lens: one of `lenses.LENSES`.
        distortion: OpenCV's k1 k2 p1 p2 k3 k4 k5 k6 (`opencv`) or k1 k2 k3 k4 (`opencv_fisheye`);
            other lenses' numbers in the order their modules give (see `lenses`).
        mask_path: a picture of the object's coverage: the photo's alpha is no more than that.
        ignored_path: a picture that is white where the photo says nothing of what is there, as where a
            hand is before it; else black. All else about it is as about `mask_path`.
        ignored_is_black: that picture is black there and white elsewhere, as nerfstudio's masks are.
        told: [h, w] bool, of any size: false where the photo says nothing (`told.told_of`); None: it says
            something everywhere, or was not looked at yet. What it says nothing of counts as out of frame.
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
    distortion: Numbers = ()
    mask_path: Path | None = None
    ignored_path: Path | None = None
    ignored_is_black: bool = False
    told: np.ndarray | None = None

    @property
    def position(self) -> np.ndarray:
        """World position [3]."""
        return self.camera_to_world[:3, 3]

    @property
    def view_direction(self) -> np.ndarray:
        """Unit world direction [3] of the optical axis; of a panorama, which has none, that of its
        picture's middle."""
        return -self.camera_to_world[:3, 2]

    @property
    def is_panoramic(self) -> bool:
        """It looks all around: where its picture's middle is says nothing of what the photo is of."""
        return self.lens in PANORAMIC

    def seen_from(self, origin: np.ndarray) -> "Camera":
        """The camera in the same world with its origin at `origin` [3]."""
        pose = self.camera_to_world.copy()
        pose[:3, 3] -= origin
        return replace(self, camera_to_world=pose)

    def placed(self, matrix: np.ndarray) -> "Camera":
        """The camera in another world: `matrix` [4, 4] is a similarity from its own to that."""
        rotation = scale_and_rotation(matrix)[1] @ self.camera_to_world[:3, :3]
        place = matrix[:3, :3] @ self.position + matrix[:3, 3]
        return replace(self, camera_to_world=rigid(rotation, place))

    def resized(self, width: int, height: int) -> "Camera":
        """The camera with a photo of another size, which shows the same."""
        across, down = width / self.width, height / self.height
        return replace(
            self, width=width, height=height, fx=self.fx * across, fy=self.fy * down,
            cx=self.cx * across, cy=self.cy * down,
        )  # fmt: skip

    def no_larger(self, pixels: int) -> "Camera":
        """The camera with a photo of about so many pixels, if it has more (0: as it is)."""
        factor = (pixels / (self.width * self.height)) ** 0.5
        if not 0 < factor < 1:
            return self
        return self.resized(*(max(1, round(factor * side)) for side in (self.width, self.height)))

    @property
    def lens_key(self) -> tuple:
        """Size, focal lengths, principal point, lens, distortion: cameras that share them see pixels along
        the same directions in camera axes."""
        return (
            self.width, self.height, self.fx, self.fy, self.cx, self.cy, self.lens,
            tuple(self.distortion),
        )  # fmt: skip

    @property
    def pixel_angle(self) -> float:
        """Angular width of a pixel on the optical axis (a panorama's equator), rad; the root of its solid
        angle."""
        return (self.fx * self.fy) ** -0.5

    def rays(self, columns: np.ndarray, rows: np.ndarray) -> Pair:
        """World origins and unit directions [N, 3] through pixel positions [N].

        Always finite: where the lens model cannot produce a pixel (see `lens_reaches`), its ray is
        the nearest that the model has.
        """
        local = unit(opengl_from_opencv(self._undistort(columns, rows)[0]))
        directions = local @ self.camera_to_world[:3, :3].T
        return np.broadcast_to(self.position, directions.shape).copy(), directions

    def project(self, points: np.ndarray) -> Pair:
        """Pixel positions [N, 2] (column, row) and depths [N] of world points [N, 3].

        Depth is the distance along the optical axis, of a panorama that from the camera. The pixel is NaN
        where the lens does not see: depth not positive (a fisheye may see behind itself), or beyond the
        distortion's fold.
        """
        offset = np.asarray(points, dtype=np.float64) - self.position
        local = opencv_from_opengl(offset @ self.camera_to_world[:3, :3])
        x, y = distort(self.lens, tuple(self.distortion), local)
        depth = np.linalg.norm(local, axis=1) if self.is_panoramic else local[:, 2]
        return np.stack([x * self.fx + self.cx, y * self.fy + self.cy], axis=-1), depth

    def depths_of_scale(self, points: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Depths [N] by which the greater focal length is divided for the pixels that a world unit across
        measures, at most, at world points [N, 3] of depths [N] (`project`): these, but of a panorama.

        Its rows are as long above and below as they are on its equator, while what they show gets smaller.
        """
        if not self.is_panoramic:
            return depth
        upward, offset = self.camera_to_world[:3, 1], points - self.position
        level = np.linalg.norm(offset - (offset @ upward)[:, None] * upward, axis=1)
        largest = max(self.fx, self.fy)
        scaled = np.minimum(level * largest / self.fx, depth * largest / self.fy)
        return np.maximum(scaled, 1e-9 * depth)  # right above and below a row has no end

    def in_frame(self, points: np.ndarray) -> np.ndarray:
        """[N] true where a world point [N, 3] before the camera lies within the photo's edges, where it is
        told."""
        return self.pixels_of(points, (self.height, self.width))[1]

    def pixels_of(self, points: np.ndarray, shape: tuple[int, int]) -> tuple[Pair, np.ndarray, np.ndarray]:
        """Rows and columns, in a photo of so many (`shape`), of the world points [N, 3] in its frame, where
        it is told; [N] which these are, and their depths (`project`)."""
        height, width = shape
        pixel, depth = self.project(points)
        x, y = pixel[:, 0] * (width / self.width), pixel[:, 1] * (height / self.height)
        # No comparison holds for NaN.
        inside = (depth > 0) & (x >= 0) & (x < width) & (y >= 0) & (y < height)
        row, column = y[inside].astype(int), x[inside].astype(int)
        if self.told is not None:
            down, across = self.told.shape
            told = self.told[row * down // height, column * across // width]
            row, column, inside[inside] = row[told], column[told], told
        return (row, column), inside, depth[inside]

    def told_at(self, shape: tuple[int, int]) -> np.ndarray | None:
        """`told` for a photo of so many rows and columns."""
        if self.told is None or self.told.shape == shape:
            return self.told
        row, column = (
            np.arange(size) * own // size for size, own in zip(shape, self.told.shape, strict=True)
        )
        return self.told[row[:, None], column]

    def lens_reaches(self, columns: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """[N] true where some ray has the pixel position; false beyond the distortion's fold."""
        return self._undistort(columns, rows)[1]

    def _undistort(self, columns: np.ndarray, rows: np.ndarray) -> Pair:
        x = (np.asarray(columns, dtype=np.float64) - self.cx) / self.fx
        y = (np.asarray(rows, dtype=np.float64) - self.cy) / self.fy
        return undistort(self.lens, tuple(self.distortion), x, y)


def positions_of(cameras: Iterable[Camera]) -> np.ndarray:
    """World positions [N, 3] of cameras."""
    return np.stack([camera.position for camera in cameras])
