"""Cells of a visual hull that silhouettes hold in place; along those of lids on hollows they only pass."""

import numpy as np
from scipy import ndimage

from ..capture.camera import Camera
from ..capture.photos import Photo
from ..capture.told import with_untold, without_untold

TOUCHING = 20 / 128
"""length within the hull, as a share of the box, up to which a silhouette's ray says where the object is"""
HELD_BY = 0.05
"""share of the photos, at least two, whose silhouettes must hold a cell"""


def held_by_silhouettes(
    cameras: list[Camera], photos: list[Photo], hull: np.ndarray, box: np.ndarray
) -> np.ndarray:
    """[K, K, K] bool: cells that rays along enough photos' silhouettes touch, or may touch."""
    cells = hull.shape[0]
    edge = float((box[1] - box[0]).max()) / cells
    centre, reach = box.mean(0), 0.9 * edge * cells
    along = np.arange(-reach, reach, edge / 2)
    votes = np.zeros(hull.size, dtype=np.int16)
    for camera, photo in zip(cameras, photos, strict=True):
        # What the frame, or what a photo says nothing of, cuts off has no silhouette there.
        mask = with_untold(photo.pixels[..., 3] > 0.5, photo.told)
        inner = ndimage.binary_erosion(mask, border_value=1)
        row, column = np.nonzero(without_untold(mask & ~inner, photo.told))
        distance = np.linalg.norm(camera.position - centre)
        stride = max(1, int(edge * max(camera.fx, camera.fy) / distance))
        origins, directions = camera.rays(column[::stride] + 0.5, row[::stride] + 0.5)
        middle = ((centre - origins) * directions).sum(-1)
        points = origins[:, None] + (middle[:, None] + along)[..., None] * directions[:, None]
        cell = np.floor((points - box[0]) / edge).astype(np.int32)
        inside = ((cell >= 0) & (cell < cells)).all(-1)
        flat = np.ravel_multi_index(np.moveaxis(cell.clip(0, cells - 1), -1, 0), hull.shape)
        inside &= hull.ravel()[flat]
        short = inside.sum(1) * edge / 2 <= TOUCHING * edge * cells
        votes[np.unique(flat[short][inside[short]])] += 1
    # Rays of neighbouring pixels are further apart than cells where those are small.
    votes = ndimage.maximum_filter(votes.reshape(hull.shape), 3)
    return (votes >= max(2, HELD_BY * len(cameras))) & hull
