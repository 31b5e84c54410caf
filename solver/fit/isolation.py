"""What of a job's photos is the object: they get alpha, where they have none and something tells."""

import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..apart import ApartError
from ..capture.agreement import another_convention
from ..capture.camera import Camera
from ..capture.capture import Capture
from ..capture.errors import CaptureError
from ..capture.panorama import panorama_of
from ..capture.photo_matches import LONGEST
from ..capture.photos import Photo
from ..capture.triangulate import Triangulated
from ..job.adjusted import write_adjusted
from ..job.folder import JobFolder
from ..job.inputs import region_of
from ..job.progress import Progress
from ..job.request import JobError
from ..light.floor import Floor
from ..replacing import remove_file
from .before_far import cut_out_before_far
from .camera_alignment import aligned
from .cut_out import backdrop_behind, cut_out
from .cut_out_standing import before_support, find_on_support, floor_below
from .far_light import NOTHING_SEEN, ROWS, SeenLight
from .panorama_file import write_panorama
from .photo_alpha import levels_of
from .point_start import found_in_photos, found_in_surroundings
from .settings import Settings
from .standing import Outline
from .standing_file import read_masks, read_standing, write_masks, write_standing
from .start import starts_from_points, uses_masks

FAR, POINTS, STANDING = 0.3, 0.6, 1.0
"""shares of the time by which it is known whether surroundings are far, where sparse points are, and
whether something stands on a support"""
AROUND_ROWS = 2 * ROWS
"""of the panorama of what is around an object that stands on something: the light takes half of them"""
POINTS_LIMIT, STANDING_LIMIT = 0.2, 0.35
"""of a time limit that the last two may take: with less left, the fit would be the worse for it"""


class Isolated(NamedTuple):
    """What a fit begins with."""

    capture: Capture  # with sparse points, where a fit without masks begins with those
    photos: list[Photo]
    light: SeenLight = NOTHING_SEEN


class _NoTime(Exception):
    pass


def isolated(
    job: JobFolder, settings: Settings, capture: Capture, photos: list[Photo], resumed: bool,
    progress: Progress, told: Callable[[float], None], device: str = "cpu",
) -> Isolated:  # fmt: skip
    """Photos with alpha as far as that can be told, and what a fit without masks begins with.

    Args:
        resumed: the fit has begun; then photos are cut out as they were.
        told: is told the share done; what it raises ends the work.
        device: on which cameras are looked for that fit outlines.

    Raises:
        CaptureError: the cameras' poses have another convention. JobError: the job goes on, but its masks
            are gone.
    """
    request, began, light, backdrop = job.request, time.monotonic(), NOTHING_SEEN, None
    region, limit = region_of(request), request.time_limit or math.inf
    if settings.fit.refine_cameras and settings.fit.use_masks and not resumed:
        capture = _by_surroundings(job, settings, capture, progress, told, POINTS_LIMIT * limit)
    # Alpha that is made here depends on cameras, and a job that goes on makes it anew.
    own_alpha = uses_masks(photos, settings)
    may = settings.fit.use_masks and settings.fit.cut_out
    standing = may and settings.fit.cut_out_standing
    if resumed and standing and job.standing_path.is_file():
        return _as_they_were(job, settings, capture, photos)
    if may:
        asked = capture if region is None else replace(capture, region=region)
        photos = cut_out(asked, photos)
        if settings.fit.cut_out_before_far:
            before = cut_out_before_far(asked, photos, lambda done: told(FAR * done))
            if before is not None:
                photos, light = before.photos, SeenLight(before.panorama)
                write_panorama(job.surroundings_path, before.panorama)
        backdrop = backdrop_behind(photos)
        if backdrop is not None:
            progress.warning(
                f"the photos have a plain {backdrop} background, but parts of the object are {backdrop} "
                "too, so no masks can be made from it; add some"
            )
    if resumed:
        return Isolated(capture, photos, light)
    if not starts_from_points(photos, settings):
        if settings.fit.refine_cameras and own_alpha and capture.has_few_points:
            capture = _by_outlines(job, capture, photos, device, progress, told, POINTS_LIMIT * limit)
        return Isolated(capture, photos, light)

    def finding_points(done: float) -> None:
        told(FAR + (POINTS - FAR) * done)

    def finding_support(done: float) -> None:
        told(POINTS + (STANDING - POINTS) * done)
        if time.monotonic() - began > STANDING_LIMIT * limit:
            raise _NoTime

    try:
        found = found_in_photos(
            capture, photos, finding_points, POINTS_LIMIT * limit, settings.fit.refine_cameras
        )
    except ApartError as error:
        progress.warning(f"no sparse points ({error}); the fit starts without them")
    else:
        if found is not None:
            capture = _with_better_cameras(job, capture, found, progress)
            capture = replace(capture, points=found.points)
    if standing and backdrop is None:
        return _on_support(job, capture, photos, region, settings.light.floor, progress, finding_support)
    return Isolated(capture, photos)


def _by_surroundings(
    job: JobFolder, settings: Settings, capture: Capture, progress: Progress,
    told: Callable[[float], None], seconds: float,
) -> Capture:  # fmt: skip
    """The capture with better cameras, if photos have mask files and what is around the object tells of
    them."""
    masked = all(camera.mask_path is not None for camera in capture.cameras)
    if not masked or not capture.has_few_points or settings.light.turntable == "yes":
        return capture
    try:
        found = found_in_surroundings(capture, told, seconds)
    except ApartError:
        return capture
    return _with_better_cameras(job, capture, found, progress)


def _with_better_cameras(
    job: JobFolder, capture: Capture, found: Triangulated, progress: Progress
) -> Capture:
    """The capture with better cameras, if what its photos have in common tells of them."""
    if found.remedy is not None:
        raise CaptureError(capture.source, "camera poses", another_convention(found.beside), found.remedy)
    if found.refined is None:
        return capture
    disagreed = f"photos and cameras disagreed by {found.beside:.1f} pixels (of {LONGEST})"
    return _adjusted(job, capture, found.refined, disagreed, found.refined_beside, progress)


def _by_outlines(
    job: JobFolder, capture: Capture, photos: list[Photo], device: str, progress: Progress,
    told: Callable[[float], None], seconds: float,
) -> Capture:  # fmt: skip
    """The capture with better cameras, if the photos' alpha does not fit them."""
    found = aligned(
        capture, photos, region_of(job.request), job.request.seed, device,
        lambda done: told(FAR + (STANDING - FAR) * done), seconds,
    )  # fmt: skip
    if found is None:
        return capture
    disagreed = f"outlines and cameras disagreed by {found.before:.1f} pixels"
    return _adjusted(job, capture, found.cameras, disagreed, found.after, progress)


def _adjusted(
    job: JobFolder, capture: Capture, cameras: list[Camera], disagreed: str, now: float, progress: Progress
) -> Capture:
    """The capture with such cameras, which the job keeps."""
    write_adjusted(job.cameras_path, cameras)
    progress.warning(
        f"{disagreed}, so cameras were adjusted: {now:.1f} now (fit.refine_cameras=no leaves them as they "
        "are)"
    )
    return replace(capture, cameras=tuple(cameras))


def _on_support(
    job: JobFolder, capture: Capture, photos: list[Photo], region: np.ndarray | None, close: bool,
    progress: Progress, told: Callable[[float], None],
) -> Isolated:  # fmt: skip
    """Photos cut out before what the object stands on, if it stands on something.

    Args:
        close: light comes from there as from close by.
    """
    # It tells a job that goes on how it began, which a stop before the first checkpoint does not settle.
    remove_file(job.standing_path)
    try:
        found = find_on_support(capture, photos, region, told)
    except _NoTime:
        found = None
    if found is None:
        return Isolated(capture, photos)
    write_masks(job.masks_dir, capture.cameras, found.outlines)
    write_standing(job.standing_path, found.standing)
    progress.warning(
        "there are no masks, so everything standing there was taken for the object (see 'masks' in the "
        "job's folder); if that is wrong, fit the region box to the object, or add masks "
        "(fit.cut_out_standing=no makes none)"
    )
    capture = replace(capture, region=found.box)
    return _isolated_by(capture, photos, found.outlines, floor_below(found.standing) if close else None)


def _isolated_by(
    capture: Capture, photos: list[Photo], outlines: list[Outline], floor: Floor | None
) -> Isolated:
    """Photos cut out along outlines, and what they show of the light around those."""
    around = panorama_of(
        capture.cameras, (levels_of(photo) for photo in photos), [o.shown for o in outlines],
        floor and floor.places, AROUND_ROWS,
    )  # fmt: skip
    cut = [before_support(p, o) for p, o in zip(photos, outlines, strict=True)]
    held = None
    if floor is not None:
        held = around.smaller(ROWS).filled_where(lambda towards: floor.places(towards)[1])
    return Isolated(capture, cut, SeenLight(held, around, floor))


def _as_they_were(job: JobFolder, settings: Settings, capture: Capture, photos: list[Photo]) -> Isolated:
    shapes = [photo.pixels.shape[:2] for photo in photos]
    outlines = read_masks(job.masks_dir, capture.cameras, shapes)
    if outlines is None:
        raise JobError(
            f"{job.masks_dir}: masks that the reconstruction began with are missing or of another size; "
            "put them back, or start a new job."
        )
    if settings.light.floor:
        return _isolated_by(capture, photos, outlines, floor_below(read_standing(job.standing_path)))
    return Isolated(capture, [before_support(p, o) for p, o in zip(photos, outlines, strict=True)])
