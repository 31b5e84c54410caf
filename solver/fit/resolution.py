"""How fine a grid photos without masks can fill."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..capture.camera import Camera
from .settings import FieldSettings


def pixels_across(cameras: list[Camera], box: np.ndarray) -> float:
    """Pixels that the edge of a cube [2, 3] has in the middle one of the photos, seen from its front."""
    edge, centre = (box[1] - box[0]).max(), box.mean(axis=0)
    distances = np.linalg.norm([camera.position - centre for camera in cameras], axis=1)
    focals = np.array([(camera.fx + camera.fy) / 2 for camera in cameras])
    # A camera in the box sees what is before it from no nearer than this.
    return float(np.median(focals * edge / np.maximum(distances, edge / 2)))


def no_finer_than_photos(
    field: FieldSettings, cameras: list[Camera], box: np.ndarray
) -> FieldSettings:
    """The field with `sizes` made smaller together, so that the finest has `nodes_per_pixel`.

    What is finer than a pixel no photo tells, and where no masks hold it, noise fills it
    (docs/decisions/0019).
    """
    if field.nodes_per_pixel == 0:
        return field
    most = field.nodes_per_pixel * pixels_across(cameras, box)
    factor = min(1.0, max(most, field.sizes[0]) / field.sizes[-1])
    return replace(field, sizes=tuple(round(factor * size) for size in field.sizes))
