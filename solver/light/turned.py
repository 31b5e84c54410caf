"""A light in other axes: an equirectangular map resampled for a world that is turned.

The fit's map stands in the capture's axes; a GLB that stands upright needs it in its own. Looking the light
up at single points would lose a sun between two of them, or count it twice. So the light of every part of
the map is shared out by how much of it, blurred bilinearly, lies in which part of the new one. The overlaps
are sampled, and so balanced (Sinkhorn & Knopp 1967): no light is lost, and even light stays even.
"""

import numpy as np
from scipy.sparse import csr_array

from ..capture.frames import direction_from_equirect, equirect_from_direction
from .environment import texel_solid_angles

_SAMPLES = 2
"""along either edge of a texel; were it odd, some would lie on the edges of turns by right angles"""
_ROUNDS = 60
"""of balancing: even light is then even to 0.4 %, and to 2 % where it is worst"""


def turned(radiance: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """The light [H, 2H, 3] float32 as a world sees it that is turned by `rotation` [3, 3].

    Its power, the integral of radiance over all directions, is that of `radiance`, to rounding.

    Args:
        radiance: [H, 2H, 3] linear Rec.709, Blender's equirect convention, in the old axes.
        rotation: takes directions from the old axes to the new ones.
    """
    height, width = radiance.shape[:2]
    solid_angle = np.repeat(texel_solid_angles(height).numpy(), width)
    cells = _cells(height, width)
    overlap, cells = _overlap(cells, rotation), cells.ravel()
    size = np.bincount(cells, solid_angle)
    old = np.ones(len(size))
    for _ in range(_ROUNDS):
        new = size / (overlap @ old)
        old = size / (overlap.T @ new)
    result = np.empty((len(cells), 3), dtype=np.float32)
    for channel, values in enumerate(radiance.reshape(-1, 3).T.astype(np.float64)):
        mean = np.bincount(cells, values * solid_angle) / size
        result[:, channel] = (new * (overlap @ (old * mean)) / size)[cells]
    return result.reshape(radiance.shape)


def _cells(height: int, width: int) -> np.ndarray:
    """Number [H, W] of the cell that each texel belongs to: towards the poles, where texels are slivers, as
    many of a row are one cell as make it about as large as a texel of the equator."""
    row, column = np.mgrid[:height, :width]
    count = np.round(width * np.sin((np.arange(height) + 0.5) * np.pi / height)).astype(int)
    first = np.cumsum(count) - count
    return first[row] + column * count[row] // width


def _overlap(cells: np.ndarray, rotation: np.ndarray) -> csr_array:
    """About how much solid angle [C, C] each cell of the turned map (rows) shares with each of the map.

    A texel reaches to its neighbours' centres with a tent's weight, as where it is looked up bilinearly.

    Args:
        cells: [H, W] of the C cells of either map.
    """
    height, width = cells.shape
    row, column = np.mgrid[:height, :width]
    count = int(cells.max()) + 1
    overlap = csr_array((count, count))
    offsets = (np.arange(2 * _SAMPLES) + 0.5) / _SAMPLES - 0.5
    for down, across in np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(-1, 2):
        uv = np.stack([(column + across) / width, (row + down) / height], axis=-1)
        u, v = np.moveaxis(equirect_from_direction(direction_from_equirect(uv) @ rotation), -1, 0)
        at = np.minimum((v * height).astype(int), height - 1), (u * width).astype(int) % width
        tent = (1 - abs(across - 0.5)) * (1 - abs(down - 0.5))
        # Beyond a pole, rows go on half a turn away.
        share = tent * np.abs(np.sin(np.pi * uv[..., 1]))
        overlap += csr_array((share.ravel(), (cells.ravel(), cells[at].ravel())), (count, count))
    return overlap
