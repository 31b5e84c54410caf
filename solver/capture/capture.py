"""The neutral capture every reader returns, and the world box its cameras look at."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .camera import Camera


@dataclass(frozen=True, eq=False)
class Capture:
    """Cameras with photos.

    Attributes:
        source: the file that was read.
        region: [2, 3] world box (min, max) that holds what the cameras look at; generous.
        warnings: sentences about what was left out.
        format: the reader's name.
    """

    source: Path
    cameras: tuple[Camera, ...]
    region: np.ndarray
    warnings: tuple[str, ...] = ()
    format: str = "transforms"


def region_seen_by(cameras: list[Camera]) -> np.ndarray:
    """World cube [2, 3] around the point where the optical axes meet, as big as the views.

    The centre minimises the squared distance to all axes; the half edge is what the median camera
    sees to either side of it.
    """
    positions = np.stack([camera.position for camera in cameras])
    axes = np.stack([camera.view_direction for camera in cameras])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    system = across.sum(0) + 1e-6 * len(cameras) * np.eye(3)
    anchor = positions.mean(0)
    target = np.einsum("nij,nj->i", across, positions) + 1e-6 * len(cameras) * anchor
    centre = np.linalg.solve(system, target)
    distance = np.maximum(np.einsum("nj,nj->n", centre - positions, axes), 0)
    if np.median(distance) <= 1e-9:
        # The axes diverge, or there is one camera: look a unit ahead.
        distance = np.ones(len(cameras))
        centre = (positions + axes).mean(0)
    half_view = [max(c.width / c.fx, c.height / c.fy) / 2 for c in cameras]
    half = float(np.median(distance * half_view))
    half = min(half, 0.9 * float(np.median(distance)))
    return np.stack([centre - half, centre + half])
