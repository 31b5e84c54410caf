"""Photos taken one after the other: their cameras may be misled by things that look alike.

Walls with one wallpaper, or the sides of a box, match though they are not the same, and COLMAP folds
the world so that they are (Cai et al., "Doppelgangers", ICCV 2023). Photos taken one after the other do
show the same things, so their matches can be trusted: a model that contradicts them, or whose camera leaps
between them, is folded, and what they alone make of the world tells which of the others fit.

`number_of` is each photo's number in the order of the walk, by its name in the database and model.
"""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ..capture.frames import unit
from .database import numbers, opened
from .pairs import NEIGHBOURS

LEAP, LEAST_LEAP = 6.0, 0.4
"""a step that is so many times the median one, and that share of the distance to what is seen, is a leap"""
AGREEMENT = np.sin(np.radians(4.0))
"""sine of the median angle between matched rays and their epipolar planes up to which a pair agrees: what a
long walk drifts, and far less than between things that only look alike"""

STEPS, FEWEST_MATCHES = 2, 30
"""photos so far apart at most, with so many verified matches, are a model's to explain"""
ENOUGH = 0.9
"""share of the cameras that a better model has to have: a missing one is better than a wrong one"""


def walked_model(
    colmap: Any, database_path: Path, model: Any, number_of: dict[str, int], in_one_take: bool,
    place: Callable[[], Any],
) -> Any:  # fmt: skip
    """A model that is not misled, where `model` is (see `misled`); None if there is none of that size.

    First of matches of neighbours alone, then also of those others that agree with it.

    Args:
        database_path: a copy, which is changed.
        in_one_take: as in `misled`.
        place: gives the largest model of the copy as it is, or None.
    """

    def good(found: Any, fewest: float) -> bool:
        if found is None or found.num_reg_images() < fewest:
            return False
        return not misled(colmap, database_path, found, number_of, in_one_take)

    with opened(colmap, database_path) as database:
        of_image = {image: number_of[name] for name, image in numbers(database).items()}
        apart = set_apart(colmap, database, of_image)
    walked = place()
    if not good(walked, ENOUGH * model.num_reg_images()):
        return None
    with opened(colmap, database_path) as database:
        agreeing = [pair for pair in apart if agrees(walked, database, *pair)]
        for pair in agreeing:
            database.write_two_view_geometry(*pair)
    closed = place() if agreeing else None
    return closed if good(closed, walked.num_reg_images()) else walked


def misled(
    colmap: Any, database_path: Path, model: Any, number_of: dict[str, int], in_one_take: bool
) -> bool:
    """True if a model contradicts what photos taken one after the other have in common.

    Args:
        in_one_take: they are of one walk without cuts, so that their camera does not leap either.
    """
    if in_one_take and leaps_of(model, number_of):
        return True
    with opened(colmap, database_path) as database:
        of_image = {image: number_of[name] for name, image in numbers(database).items()}
        for pair, geometry in zip(*database.read_two_view_geometries(), strict=True):
            one, other = colmap.pair_id_to_image_pair(pair)
            near = abs(of_image[one] - of_image[other]) <= STEPS
            if near and len(geometry.inlier_matches) >= FEWEST_MATCHES and _placed(model, one, other):
                if not agrees(model, database, one, other, geometry):
                    return True
    return False


def leaps(steps: dict[int, np.ndarray], distance: float) -> list[int]:
    """Numbers of the photos to which the camera leapt.

    Args:
        steps: position [3] of each photo that has one, by its number in the order of the walk.
        distance: to what the cameras see, in the same units.
    """
    order = sorted(steps)
    if len(order) < 4:
        return []
    # Steps over photos without a camera count as that many.
    lengths = np.array([np.linalg.norm(steps[b] - steps[a]) / (b - a) for a, b in pairwise(order)])
    least = max(LEAP * float(np.median(lengths)), LEAST_LEAP * distance)
    return [number for number, length in zip(order[1:], lengths, strict=True) if length > least]


def leaps_of(model: Any, number_of: dict[str, int]) -> list[int]:
    """As `leaps`, of COLMAP's model."""
    placed = [image for image in model.images.values() if image.has_pose]
    steps = {number_of[image.name]: image.projection_center() for image in placed}
    points = np.array([point.xyz for point in model.points3D.values()]).reshape(-1, 3)
    if not len(points):
        return []
    middle = np.median(points, axis=0)
    distance = np.median([np.linalg.norm(centre - middle) for centre in steps.values()])
    return leaps(steps, float(distance))


def set_apart(colmap: Any, database: Any, number_of: dict[int, int]) -> list[tuple[int, int, Any]]:
    """Take all pairs of photos that are further apart than neighbours out of a database.

    Args:
        colmap: the module. number_of: each photo's number in the order of the walk by the database's own.

    Returns:
        Both of the database's numbers and COLMAP's geometry of each.
    """
    apart = []
    for pair, geometry in zip(*database.read_two_view_geometries(), strict=True):
        one, other = colmap.pair_id_to_image_pair(pair)
        if abs(number_of[one] - number_of[other]) > NEIGHBOURS:
            apart.append((one, other, geometry))
            database.delete_two_view_geometry(one, other)
    return apart


def agrees(model: Any, database: Any, one: int, other: int, geometry: Any) -> bool:
    """True if a pair's matches fit to where a model has its two cameras."""
    if not _placed(model, one, other) or not len(geometry.inlier_matches):
        return False
    images = [model.image(number) for number in (one, other)]
    rays = []
    for image, column in zip(images, geometry.inlier_matches.T, strict=True):
        pixels = database.read_keypoints(image.image_id)[column, :2].astype(np.float64)
        across = np.asarray(image.camera.cam_from_img(pixels))
        ray = np.concatenate([across, np.ones((len(across), 1))], axis=1)
        rays.append(unit(ray))
    between = images[1].cam_from_world() * images[0].cam_from_world().inverse()
    return bool(np.nanmedian(off_epipolar(*rays, between.matrix())) <= AGREEMENT)


def _placed(model: Any, *numbers: int) -> bool:
    return all(model.exists_image(i) and model.image(i).has_pose for i in numbers)


def off_epipolar(rays: np.ndarray, others: np.ndarray, between: np.ndarray) -> np.ndarray:
    """Sine [N] of the angles between rays of one camera and the epipolar planes of another's.

    Args:
        rays, others: unit directions [N, 3], each in its own camera's axes.
        between: [3, 4] from the first camera's axes to the other's.
    """
    normals = np.cross(between[:, 3], rays @ between[:, :3].T)
    length = np.linalg.norm(normals, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.abs((normals * others).sum(axis=1)) / length
