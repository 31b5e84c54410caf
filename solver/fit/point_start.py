"""The start of a fit without masks: a fog that is denser where sparse points say that something is."""

import math
import time
from collections.abc import Callable

import numpy as np
import torch
from scipy import ndimage

from ..apart import ApartError
from ..capture.capture import Capture
from ..capture.photo_matches import picture_of
from ..capture.photos import Photo
from ..capture.refine import TOLERATED
from ..capture.surroundings import TOLERATED_AROUND, picture_around
from ..capture.triangulate import Triangulated, compare_some, pictures_by, triangulate
from ..field.field import MicrofacetField
from ..field.room import EXTENT, Room, contract
from .visual_hull import decompose

COMPARING = 0.2
"""of the time that better cameras are looked for in"""
REACH = 1.7
"""standard deviation, in nodes of the grid, over which a point makes the fog denser"""


def found_in_photos(
    capture: Capture, photos: list[Photo], progress: Callable[[float], None],
    seconds: float = math.inf, refine: bool = False,
) -> Triangulated | None:  # fmt: skip
    """Sparse points that a capture's photos have in common; None: its file has enough.

    Args:
        progress: told the share done; what it raises ends the search.
        seconds: that the search may take.
        refine: look for better cameras, too.

    Raises:
        ApartError: they cannot be found, or not in time.
    """
    if not capture.has_few_points:
        return None
    told = _in_time(progress, seconds)
    pictures = [picture_of(photo) for photo in photos]
    return triangulate(list(capture.cameras), pictures, told, TOLERATED if refine else None)


def found_in_surroundings(
    capture: Capture, progress: Callable[[float], None], seconds: float = math.inf
) -> Triangulated:
    """What photos with mask files have in common around the object, and better cameras, if these are off.

    Args:
        progress, seconds: as `found_in_photos`.

    Raises:
        ApartError: as `found_in_photos`. CaptureError: a photo or its mask cannot be read.
    """
    told, cameras = _in_time(progress, seconds), capture.cameras
    found = compare_some(cameras, picture_around, lambda done: told(COMPARING * done))
    if found.remedy is not None or found.beside is None or found.beside < TOLERATED_AROUND:
        return found
    pictures = pictures_by(picture_around, cameras, lambda: told(COMPARING))
    return triangulate(
        list(cameras), pictures, lambda done: told(COMPARING + (1 - COMPARING) * done), TOLERATED_AROUND
    )


def _in_time(progress: Callable[[float], None], seconds: float) -> Callable[[float], None]:
    """Told the share done, and ends what takes longer."""
    began = time.monotonic()

    def told(done: float) -> None:
        progress(done)
        if time.monotonic() - began > seconds:
            raise ApartError("there is no time to find them")

    return told


def start_from_points(
    field: MicrofacetField, room: Room | None, points: np.ndarray, density: float
) -> None:
    """Set the raw density of field and room, which are at their start, to `density` at `points`.

    Elsewhere it is about 0: the fog that they begin with.

    Args:
        points: [N, 3] world; those outside the box are the room's.
    """
    world = torch.as_tensor(points, dtype=torch.float32)
    inside = density * density_near(2 * field.to_box(world) - 1, field.size)
    found = [(inside, field.density_planes, field.density_lines)]
    if room is not None:
        unit = room.to_unit(world)
        outside = contract(unit[(unit.abs() > 1).any(-1)]) / EXTENT
        found.append((density * density_near(outside, room.size), room.planes, room.lines))
    with torch.no_grad():
        for target, planes, lines in found:
            for parameter, factor in zip((planes, lines), decompose(target, planes.shape[-1]), strict=True):
                parameter.copy_(factor)


def density_near(points: torch.Tensor, size: int) -> torch.Tensor:
    """[G, G, G] on the nodes of a cube from −1 to 1: 1 at points [N, 3] in it, falling to 0 around them."""
    node = ((points + 1) * (0.5 * (size - 1))).round().long()
    node = node[((node >= 0) & (node < size)).all(-1)]
    grid = np.zeros((size,) * 3, dtype=np.float32)
    grid[tuple(node.T.numpy())] = 1.0
    # A point by itself is to reach 1, and many beside each other no more.
    alone = (2 * np.pi * REACH**2) ** 1.5
    return torch.from_numpy(np.minimum(alone * ndimage.gaussian_filter(grid, REACH), 1.0))
