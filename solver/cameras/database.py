"""COLMAP's database of a solve: photos and lenses go into it, evidence of what they share comes out.

`colmap` is the module pycolmap, which `solve` imports when it is used.
"""

from collections import defaultdict
from pathlib import Path
from typing import Any

from ..capture.errors import CaptureError
from ..capture.photo_matches import add_camera, add_photo, opened
from .diagnosis import Evidence
from .folder import SolveRequest
from .prepare import Prepared

DEFAULT_FOCAL, FISHEYE_FOCAL = 1.2, 0.35
"""focal length over the longer side, where a photo says nothing: a phone's main camera and most lenses; and
lenses that see some 165° across"""


def numbers(database: Any) -> dict[str, int]:
    """The database's own number of every photo in it, by file name."""
    return {image.name: image.image_id for image in database.read_all_images()}


def has_features(colmap: Any, path: Path) -> bool:
    """True if features of any photo were looked for: only then is there work in a database."""
    if not path.exists():
        return False
    with opened(colmap, path) as database:
        return any(map(database.exists_descriptors, numbers(database).values()))


def register(colmap: Any, path: Path, photos: list[Prepared], request: SolveRequest) -> None:
    """Put photos and lenses into a new database, all or nothing.

    Raises:
        CaptureError: photos of unlike sizes are to share a lens.
    """
    with opened(colmap, path) as database:
        if database.num_images() == len(photos):
            return
        database.clear_all_tables()
        with colmap.DatabaseTransaction(database):
            rigs: dict[Any, tuple[Any, int]] = {}
            for photo in photos:
                key = {"single": 0, "each": photo.number}.get(request.sharing, photo.lens_key)
                if key not in rigs:
                    rigs[key] = _new_rig(colmap, database, photo, request.camera_model)
                camera, rig = rigs[key]
                if (camera.width, camera.height) != (photo.small_width, photo.small_height):
                    raise CaptureError(
                        photo.path, "", f"the photo is {photo.width} × {photo.height} pixels "
                        "and others are not, so they cannot share a lens",
                        "solve without One Lens (--single-camera)",
                    )  # fmt: skip
                add_photo(colmap, database, photo.file, camera, rig)


def _new_rig(colmap: Any, database: Any, photo: Prepared, model: str) -> tuple[Any, int]:
    factor = photo.small_width / photo.width
    longer = max(photo.small_width, photo.small_height)
    is_fisheye = model == "OPENCV_FISHEYE"
    usual = FISHEYE_FOCAL if is_fisheye else DEFAULT_FOCAL
    focal = usual * longer if photo.focal is None else photo.focal * factor
    camera = colmap.Camera.create_from_model_name(0, model, focal, photo.small_width, photo.small_height)
    # Through a fisheye COLMAP finds photos alike only if it may take its focal length for about right.
    camera.has_prior_focal_length = is_fisheye or photo.focal is not None
    return camera, add_camera(colmap, database, camera)


def evidence_of(colmap: Any, path: Path, photos: list[Prepared]) -> list[Evidence]:
    """Each photo's features, and the matches it has with every other that it shares any with."""
    matches: dict[int, list[int]] = defaultdict(list)
    with opened(colmap, path) as database:
        number = numbers(database)
        for pair, count in zip(*database.read_two_view_geometry_num_inliers(), strict=True):
            for image in colmap.pair_id_to_image_pair(pair):
                if count > 0:
                    matches[image].append(int(count))
        return [
            Evidence(
                photo.name, database.num_keypoints_for_image(number[photo.file]),
                tuple(matches[number[photo.file]]),
            )
            for photo in photos
        ]  # fmt: skip
