"""Cameras that fit their photos better: poses measured by a phone are some pixels off, and drift.

What photos have in common is triangulated with the poses as they are, generously, and then all poses and
points are adjusted together (Triggs et al. 2000, doi:10.1007/3-540-44480-7_21), by COLMAP; and once more,
strictly. Lenses stay.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from ..threads import usable_cores
from .agreement import disagreement
from .camera import Camera, positions_of
from .frames import pose_of_opencv
from .photo_matches import DATABASE, Features, PairMatches, image_of, posed_model

TOLERATED = 0.75
"""pixels, of pictures that features were sought in, by which photos may lie beside their cameras; COLMAP's
own lie 0.3"""
BETTER = 0.5
"""of that: what adjusted cameras have to reach"""
STRICT, GENEROUS, STEP = 4.0, 16.0, 4.0
"""pixels from which on an observation does not belong to its point: at last, as COLMAP has it; and at
first, or `STEP` times what photos lie beside their cameras, if that is more, less by `STEP` each round"""
DEGREES_PER_PIXEL = 0.5
"""the same for rays, as COLMAP's own settings have it"""
FEWEST_OBSERVATIONS = 20
"""of a camera that is moved"""
MOST_TURNED, MOST_MOVED = np.radians(10), 0.1
"""by which the median camera may be moved, the second as a share of their mean distance from their centre:
more is no mistake of measuring, such as all photos showing what turned with the camera"""


def triangulated(
    colmap: Any, folder: Path, cameras: list[Camera], features: list[Features], most_pixels: float = STRICT
) -> Any:
    """COLMAP's model of cameras where they are, with the points that their photos have in common."""
    options = colmap.IncrementalPipelineOptions()
    options.extract_colors, options.num_threads = False, usable_cores()
    options.random_seed = options.triangulation.random_seed = 0
    if most_pixels != STRICT:
        found = options.triangulation
        found.merge_max_reproj_error = found.complete_max_reproj_error = most_pixels
        found.create_max_angle_error = DEGREES_PER_PIXEL * most_pixels
        found.continue_max_angle_error = DEGREES_PER_PIXEL * most_pixels
        options.mapper.filter_max_reproj_error = most_pixels
    model = posed_model(colmap, cameras, features)
    return colmap.triangulate_points(model, folder / DATABASE, folder, folder, True, options)


def refined(
    colmap: Any, folder: Path, cameras: list[Camera], features: list[Features],
    pairs: list[PairMatches], beside: float | None, tolerated: float = TOLERATED,
) -> tuple[list[Camera], float] | None:  # fmt: skip
    """Cameras in the same world that fit their photos better, and how far beside these lie then; None: they
    fit, or nothing better is found.

    Args:
        folder: with the database of `photo_matches.matched`.
        features, pairs: of it.
        beside: how far beside the cameras photos lie (see `agreement.disagreement`).
        tolerated: pixels by which they may, before and after.
    """
    if beside is None or beside < tolerated:
        return None
    found = cameras
    for most_pixels in rounds_for(beside):
        model = triangulated(colmap, folder, found, features, most_pixels)
        found = _adjusted(colmap, model, found)
        if found is None:
            return None
    after = disagreement(found, pairs)
    better = after is not None and after < min(tolerated, BETTER * beside)
    return (found, after) if better and _may_be(cameras, found) else None


def rounds_for(beside: float) -> list[float]:
    """Pixels from which on an observation does not belong to its point, round by round."""
    rounds, pixels = [], max(GENEROUS, STEP * beside)
    while pixels > STRICT:
        rounds.append(pixels)
        pixels /= STEP
    return [*rounds, STRICT]


def _adjusted(colmap: Any, model: Any, cameras: list[Camera]) -> list[Camera] | None:
    """Cameras as they fit the model's points best; None: most show too little. Those that do stay as they
    are."""
    told = [image_of(model, i).num_points3D >= FEWEST_OBSERVATIONS for i in range(len(cameras))]
    if sum(told) < len(cameras) / 2 or sum(told) < 3:
        return None
    options = colmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.refine_focal_length = options.refine_principal_point = False
    options.refine_extra_params = False
    options.ceres.loss_function_type = colmap.LossFunctionType.CAUCHY
    config = colmap.BundleAdjustmentConfig()
    for index, enough in enumerate(told):
        if enough:
            config.add_image(image_of(model, index).image_id)
    config.fix_gauge(colmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    colmap.create_default_bundle_adjuster(options, config, model).solve()
    moved = list(cameras)
    indices = [index for index, enough in enumerate(told) if enough]
    for index in indices:
        from_world = image_of(model, index).cam_from_world().matrix()
        pose = pose_of_opencv(np.vstack([from_world, (0, 0, 0, 1)]))
        moved[index] = replace(cameras[index], camera_to_world=pose)
    # Photos know no world: it stays where it was, as does its scale.
    back, _, _ = trimesh.registration.procrustes(
        positions_of(moved)[indices], positions_of(cameras)[indices], reflection=False
    )
    for index in indices:
        moved[index] = moved[index].placed(back)
    return moved


def _may_be(given: list[Camera], found: list[Camera]) -> bool:
    """True if cameras were moved by no more than what may have been measured wrongly."""
    to, at = positions_of(found), positions_of(given)
    spread = np.linalg.norm(at - at.mean(0), axis=1).mean()
    moved = np.median(np.linalg.norm(to - at, axis=1))
    turns = [
        Rotation.from_matrix(g.camera_to_world[:3, :3].T @ f.camera_to_world[:3, :3])
        for g, f in zip(given, found, strict=True)
    ]
    turned = np.median([turn.magnitude() for turn in turns])
    return bool(moved < MOST_MOVED * spread and turned < MOST_TURNED)
