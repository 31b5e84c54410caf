"""Sparse points where a capture has cameras but no points: what photos of one place have in common; and
better cameras, where photos show that these are off.

Textured things get points, shiny and plain ones hardly any.
"""

import tempfile
from collections.abc import Callable, Sequence
from contextlib import chdir
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..apart import run_apart
from ..threads import thread_pool
from .agreement import convention_that_fits, disagreement
from .camera import Camera
from .capture import evenly_taken
from .photo_matches import Picture, matched, neighbours, quiet_colmap, verified_matches
from .photos import MOST_AT_ONCE
from .refine import refined, triangulated

FEWEST_VIEWS = 3
"""photos that must agree on a point: two do by chance along an epipolar line"""
NO_POINTS = np.zeros((0, 3))
MATCHING = 0.7
"""of the time, for the progress"""
PAIRS, NEAREST = 12, 2
"""that are compared where some do, and of how many of each camera's neighbours they are chosen"""


class Triangulated(NamedTuple):
    """What photos have in common.

    `beside` is by how many pixels the photos lie beside their cameras, of pictures as long as
    `photo_matches.LONGEST` (None: they have too little in common), and beside those that are `refined`,
    if better ones were found. `remedy` is what to do with matrices of another convention, of which no
    points are sought.
    """

    points: np.ndarray  # [N, 3] world
    beside: float | None = None
    remedy: str | None = None
    refined: list[Camera] | None = None
    refined_beside: float | None = None


def triangulate(
    cameras: list[Camera], pictures: list[Picture], progress: Callable[[float], None],
    tolerated: float | None = None,
) -> Triangulated:  # fmt: skip
    """World points on what at least `FEWEST_VIEWS` photos see alike, maybe none.

    Args:
        cameras: of the photos, in the order of their pictures; any lens.
        progress: told the share done, several times a second; what it raises ends the work.
        tolerated: look for better cameras, too, and take those, where photos lie further than so many
            pixels beside these; None: leave them.

    Raises:
        ApartError: COLMAP cannot do it.
    """
    if len(cameras) < FEWEST_VIEWS:
        return Triangulated(NO_POINTS)
    with _temporary_folder("nmf-points-") as folder:
        # In one process, COLMAP's and torch's OpenMP runtimes end Python on macOS.
        return run_apart(
            _within, Path(folder), with_colmap, cameras, pictures, tolerated, progress=progress
        )


def _within(folder: Path, work: Callable[..., Triangulated], *args: Any) -> Triangulated:
    """What `work(folder, *args)` returns, told a folder of plain letters: on Windows COLMAP opens no path
    with letters that the system's code page has not."""
    with chdir(folder):
        return work(Path(), *args)


def _temporary_folder(prefix: str) -> tempfile.TemporaryDirectory:
    # On Windows a file that somebody looks at stays; that is no reason for the work to fail.
    return tempfile.TemporaryDirectory(prefix=prefix, ignore_cleanup_errors=True)


def with_colmap(
    folder: Path, cameras: list[Camera], pictures: list[Picture], tolerated: float | None,
    progress: Callable[[float], None],
) -> Triangulated:  # fmt: skip
    """As `triangulate`, in this process and an empty folder."""
    colmap, pairs = quiet_colmap(), neighbours(cameras)
    features = matched(colmap, folder, cameras, pictures, pairs, lambda done: progress(MATCHING * done))
    matches = verified_matches(colmap, folder, features)
    beside, remedy = disagreement(cameras, matches), convention_that_fits(cameras, matches)
    if remedy is not None:
        return Triangulated(NO_POINTS, beside, remedy)
    better = None
    if tolerated is not None:
        better = refined(colmap, folder, cameras, features, matches, beside, tolerated)
    found, after = better or (None, None)
    model = triangulated(colmap, folder, found or cameras, features)
    progress(1.0)
    points = [p.xyz for p in model.points3D.values() if p.track.length() >= FEWEST_VIEWS]
    return Triangulated(np.array(points, dtype=np.float64).reshape(-1, 3), beside, None, found, after)


def compare_some(
    cameras: Sequence[Camera], picture_of: Callable[[Camera], Picture],
    progress: Callable[[float], None] = lambda done: None,
) -> Triangulated:  # fmt: skip
    """As `compare`, of `PAIRS` pairs of neighbours, all around; takes some seconds.

    Raises:
        ApartError: as `compare`. Whatever `picture_of` raises.
    """
    near = neighbours(list(cameras), NEAREST)
    if not near:
        return Triangulated(NO_POINTS)
    pairs = [near[i] for i in evenly_taken(len(near), PAIRS)]
    chosen = sorted({index for pair in pairs for index in pair})
    place = {index: number for number, index in enumerate(chosen)}
    some = [cameras[i] for i in chosen]
    pictures = pictures_by(picture_of, some, lambda: progress(0.0))
    return compare(some, pictures, [(place[i], place[j]) for i, j in pairs], progress)


def pictures_by(
    picture_of: Callable[[Camera], Picture], cameras: Sequence[Camera], goes_on: Callable[[], None]
) -> list[Picture]:
    """The pictures of cameras, made side by side; what `goes_on` raises ends it."""
    pictures = []
    with thread_pool(MOST_AT_ONCE) as pool:
        for picture in pool.map(picture_of, cameras):
            pictures.append(picture)
            goes_on()
    return pictures


def compare(
    cameras: list[Camera], pictures: list[Picture], pairs: list[tuple[int, int]],
    progress: Callable[[float], None],
) -> Triangulated:  # fmt: skip
    """How well photos fit their cameras, by some pairs of them; no points are sought.

    Raises:
        ApartError: COLMAP cannot do it.
    """
    with _temporary_folder("nmf-pairs-") as folder:
        return run_apart(
            _within, Path(folder), compare_with_colmap, cameras, pictures, pairs, progress=progress
        )


def compare_with_colmap(
    folder: Path, cameras: list[Camera], pictures: list[Picture],
    pairs: list[tuple[int, int]], progress: Callable[[float], None],
) -> Triangulated:  # fmt: skip
    """As `compare`, in this process and an empty folder."""
    colmap = quiet_colmap()
    features = matched(colmap, folder, cameras, pictures, pairs, progress)
    found = verified_matches(colmap, folder, features)
    return Triangulated(NO_POINTS, disagreement(cameras, found), convention_that_fits(cameras, found))
