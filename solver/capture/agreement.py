"""How well photos fit their cameras: by what two photos both show, without knowing where that is."""

from dataclasses import replace

import numpy as np

from .camera import Camera, positions_of
from .frames import invert_pose, pose_of_opencv, pose_opencv_from_opengl, pose_opengl_from_opencv, unit
from .photo_matches import LONGEST, PairMatches

FEWEST_MATCHES = 15
"""of a pair: with fewer, chance matters too much"""
PAIRS_PER_CAMERA = 1 / 3
"""pairs with enough for each camera, or nothing is said of them"""
NO_WAY = 1e-9
"""distance of two cameras up to which they see from one place, as a share of how far all are spread"""
FIT, DO_NOT_FIT = 1.0, 5.0
"""pixels: cameras in one of the usual conventions fit photos that well, or that badly in another"""


def epipolar_errors(cameras: list[Camera], pairs: list[PairMatches]) -> np.ndarray:
    """Pixels [P] by which what two photos both show would have to move, in both together, to lie where
    their cameras say; the median of each pair that has enough matches and sees from two places.

    It is Sampson's distance (Hartley and Zisserman, Multiple View Geometry, §11.4.3) of directions, as
    pixels in the middle of the picture, so it is the same all over a fisheye's. How far away things are is
    open: only what is beside the plane through both cameras counts.
    """
    to_camera = [invert_pose(pose_opencv_from_opengl(c.camera_to_world)) for c in cameras]
    positions = positions_of(cameras)
    spread = np.linalg.norm(positions - positions.mean(0), axis=1).max()
    errors = []
    for pair in pairs:
        way = np.linalg.norm(positions[pair.first] - positions[pair.second])
        if pair.seen.shape[1] < FEWEST_MATCHES or way <= NO_WAY * spread:
            continue
        turn = to_camera[pair.second] @ invert_pose(to_camera[pair.first])
        x, y, z = turn[:3, 3]
        essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ turn[:3, :3]
        first, second = unit(pair.seen)
        planes, planes_back = first @ essential.T, second @ essential
        beside = np.abs((second * planes).sum(1))
        slope = np.sqrt((planes**2).sum(1) + (planes_back**2).sum(1))
        errors.append(pair.focal * np.median(beside / np.maximum(slope, 1e-30)))
    return np.array(errors)


def disagreement(cameras: list[Camera], pairs: list[PairMatches]) -> float | None:
    """Pixels by which photos lie beside their cameras, the median of pairs; None: they have too little in
    common to tell."""
    errors = epipolar_errors(cameras, pairs)
    enough = len(errors) > 0 and len(errors) >= PAIRS_PER_CAMERA * len(cameras)
    return float(np.median(errors)) if enough else None


def convention_that_fits(cameras: list[Camera], pairs: list[PairMatches]) -> str | None:
    """What to do with cameras whose convention is not the one they were read in, or with their photos: one
    clause; None if they fit as they are, or in no other either."""
    given = disagreement(cameras, pairs)
    if given is None or given < DO_NOT_FIT:
        return None
    for remedy, read_as in _CONVENTIONS.items():
        other = [replace(c, camera_to_world=read_as(c.camera_to_world)) for c in cameras]
        error = disagreement(other, pairs)
        if error is not None and error < FIT:
            return remedy
    return None


def another_convention(beside: float) -> str:
    """What is wrong with such cameras, one clause, of which photos lie so many pixels beside."""
    return (
        f"photos and cameras disagree by {beside:.0f} pixels (of {LONGEST}), but not if the poses are "
        "read in another convention"
    )


_CONVENTIONS = {
    "negate the second and third column of each, since they look along +Z with +Y down": (
        pose_opengl_from_opencv
    ),
    "invert each, since they are from world to camera": invert_pose,
    "invert each and negate the second and third column of that, since they are from world to camera, of "
    "cameras that look along +Z with +Y down": pose_of_opencv,
    "rotate the photos by 180°, since they are upside down in their files (EXIF orientation is not "
    "followed here, as in most programs)": lambda pose: pose * (-1.0, -1.0, 1.0, 1.0),
}
