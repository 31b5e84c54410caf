"""From what a camera file says to a capture: what all readers share."""

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .camera import Camera
from .capture import Capture, region_seen_by
from .errors import CaptureError, counted, shown, told_of
from .fields import SOLVE_AGAIN, rigid_pose
from .image_header import EXTENSIONS, UnknownSize, image_orientation, image_size, is_raw
from .lenses import is_usable
from .mask_finder import none_fits
from .orientation import same_shape
from .photo_finder import PhotoFinder
from .picture_names import agreement, folders_of, on_windows, parts_of

_BORDER = 0.05
"""share of a sensor's width that programs which develop raw photos may leave out or not"""


@dataclass(frozen=True)
class Intrinsics:
    """A lens on a sensor; see `Camera` for the fields."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    lens: str = "pinhole"
    distortion: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class Found:
    """A camera as a file states it.

    Attributes:
        where: the field or line that states it, for errors.
        stated: what the file calls its photo.
        photo: the picture; None if there is none.
        camera_to_world: [4, 4] or [3, 4], OpenGL camera axes; checked by `assemble`.
        intrinsics: for the photo as the file knew it; None if a camera without a photo is of no use.
        mask: the mask the file names, as `PhotoFinder.mask_of` gives it; None looks for one.
        ignored: the picture the file names of what is to be ignored (`Camera.ignored_path`); None looks for
            one. What a person gives counts before it.
        ignored_is_black: the file's is black there.
    """

    where: str
    stated: str
    photo: Path | None
    camera_to_world: object
    intrinsics: Intrinsics | None
    mask: Path | None = None
    ignored: Path | None = None
    ignored_is_black: bool = False


def assemble(
    source: Path, format: str, found: list[Found], photos: PhotoFinder, *,
    points: np.ndarray | None = None, up: tuple[float, float, float] | None = None,
    metric: bool = False, warnings: tuple[str, ...] = (), lost: tuple[list[str], str] | None = None,
) -> Capture:  # fmt: skip
    """A capture of all cameras whose photos are there, or of all where `photos` are not wanted.

    Cameras without a photo that is wanted are left out with a warning, as long as half of them and
    as many as `photos` asks for are there. Intrinsics follow a photo that was made smaller or larger since.

    Args:
        source: the camera file. format: the reader's name.
        points: [N, 3] sparse points in the file's world.
        up: the world's axis that points up, if the format says so.
        metric: world units are metres.
        lost: photos without a pose, the field of poses, and what to do if all are.

    Raises:
        CaptureError: anything that cannot be used.
    """
    if lost is not None:
        warnings = without_pose(source, len(found) + len(lost[0]), *lost) + warnings
    if not found:
        raise CaptureError(source, "cameras", "there are none in it", "export the cameras again")
    found = _in_their_folders(found)
    there = [item for item in found if photos.serves(item.photo)]
    missing = [item.stated for item in found if not photos.serves(item.photo)]
    if len(there) < photos.fewest or len(missing) > len(there):
        raise _too_few(source, len(found), missing, photos)
    notes = list(warnings)
    if missing:
        what = f"of {len(found)} listed photos does|do not exist and is|are left out"
        notes.insert(0, told_of(source, missing, what))
    names: set[str] = set()
    cameras, resized = [], []
    for item in there:
        pose = rigid_pose(source, item.where, item.camera_to_world)
        intrinsics, changed = _for_photo(source, item)
        if changed:
            resized.append(item.photo.name)
        mask = item.mask
        if mask is None and item.photo is not None:
            mask = photos.mask_of(item.photo)
        file_name = "".join(parts_of(item.stated)[-1:]) if item.photo is None else item.photo.name
        cameras.append(
            Camera(
                name=_unique_name(file_name, names), image_path=item.photo,
                camera_to_world=pose, mask_path=mask, **_ignored(item, photos), **vars(intrinsics),
            )
        )  # fmt: skip
    given = photos.ignored.given
    if photos.wanted and given is not None and not any(c.ignored_path for c in cameras):
        raise none_fits(given, cameras[0].image_path.name, "ignore")
    if photos.wanted and not any(camera.mask_path for camera in cameras):
        if photos.masks.masks is not None:
            raise none_fits(photos.masks.masks, cameras[0].image_path.name)
        if (unused := photos.masks.first()) is not None:
            notes.append(f"{unused} and others look like masks but are not used; name them like the photos")
    if resized:
        notes.append(f"the cameras say another size for {len(resized)} of {len(cameras)} photos (the "
                     f"first: {resized[0]}); the lenses were scaled with them")  # fmt: skip
    notes += _same_places(cameras)
    points = _usable(points)
    return Capture(
        source, tuple(cameras), region_seen_by(cameras, points), tuple(notes), format, points,
        None if up is None else np.array(up, dtype=np.float64), metric,
    )  # fmt: skip


def _too_few(source: Path, count: int, missing: list[str], photos: PhotoFinder) -> CaptureError:
    """The error that of `count` cameras too few are left without those whose photos are `missing`."""
    if missing:
        other = photos.unreadable(missing[0])
        if other is not None:
            return CaptureError(
                other, "", f"photos of this kind ({other.suffix}) cannot be read",
                "convert all to JPEG or PNG under the same names",
            )  # fmt: skip
        return CaptureError(
            source, "photos", counted(f"{len(missing)} of {count} photos is|are missing, ")
            + f"the first is '{shown(missing[0])}'",
            f"put the photos below {photos.folder}, give the folder of the whole project, or give "
            "the photos' folder",
        )  # fmt: skip
    return CaptureError(
        source, "cameras",
        "there is only 1 camera" if count == 1 else f"there are only {count} cameras",
        f"a reconstruction needs at least {photos.fewest}, better 50",
    )  # fmt: skip


def without_pose(
    source: Path, count: int, lost: list[str], field: str, remedy: str = SOLVE_AGAIN
) -> tuple[str, ...]:
    """The warning that `lost` of `count` photos have no pose and are left out; none if none is lost.

    Raises:
        CaptureError: all are lost; `field` and `remedy` are its own.
    """
    if not lost:
        return ()
    if len(lost) == count:
        none = "its photo has no" if count == 1 else f"none of its {count} photos has a"
        raise CaptureError(source, field, f"{none} pose", remedy)
    return (told_of(source, lost, f"of {count} photos has|have no pose and is|are left out"),)


def _ignored(item: Found, photos: PhotoFinder) -> dict[str, object]:
    """The fields of a camera that say what is to be ignored of its photo."""
    named = {"ignored_path": item.ignored, "ignored_is_black": item.ignored_is_black}
    if item.photo is None or (item.ignored is not None and photos.ignored.given is None):
        return named
    found = photos.ignored.of(item.photo)
    return named if found is None else {"ignored_path": found}


def _in_their_folders(found: list[Found]) -> list[Found]:
    """Cameras without the photos that were found in another folder than they should be in.

    Where train/a.png is missing, test/a.png may have been found: if any photo of train/ was found in a
    folder that fits better, or if another camera has that very photo by a name that does.
    """
    fits: list[int] = []
    of_photo: dict[Path | None, int] = {}
    of_folder: dict[tuple[str, ...], int] = {}
    for item in found:
        told = folders_of(parts_of(item.stated))
        fits.append(-1 if item.photo is None else agreement(folders_of(item.photo.parts), told))
        of_photo[item.photo] = max(fits[-1], of_photo.get(item.photo, -1))
        of_folder[tuple(told)] = max(fits[-1], of_folder.get(tuple(told), -1))
    return [
        item
        if fit == of_photo[item.photo] == of_folder[tuple(folders_of(parts_of(item.stated)))]
        else replace(item, photo=None)
        for item, fit in zip(found, fits, strict=True)
    ]


def _for_photo(source: Path, item: Found) -> tuple[Intrinsics, bool]:
    """Intrinsics for the picture as it is now, if there is one, and whether they had to be scaled."""
    intrinsics = item.intrinsics
    if intrinsics is None:
        problem, remedy = "the camera has no lens", "export it again"
        if item.photo is None:
            problem = f"the photo '{shown(item.stated)}', which tells the camera's size, is missing"
            remedy = "add it, or give a transforms.json with w and h"
        raise CaptureError(source, item.where, problem, remedy)
    values = (intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy, *intrinsics.distortion)
    finite = np.isfinite(values).all() and min(intrinsics.fx, intrinsics.fy) > 0
    if not finite or not is_usable(intrinsics.lens, intrinsics.distortion):
        raise CaptureError(
            source, item.where, "the lens has a value that no lens can have",
            "correct it, or export it again",
        )  # fmt: skip
    told = (intrinsics.width, intrinsics.height)
    if min(told) < 1 or max(told) > 1e6:
        raise CaptureError(source, item.where, "the photo has no size")
    if item.photo is None:
        return intrinsics, False
    try:
        width, height = image_size(item.photo)
    except UnknownSize:
        return intrinsics, False  # the solver, which can read it, looks once more
    may_turn = image_orientation(item.photo) >= 5
    if told == (width, height) or (may_turn and told == (height, width)):
        return intrinsics, False
    fits = same_shape((width, height), told)
    if may_turn and not fits and same_shape((height, width), told):
        # It was solved upright and lies on its side in its file.
        width, height, fits = height, width, True
    # A raw photo of nearly its camera's size was developed with another border, not made smaller.
    if fits and is_raw(item.photo) and abs(width / told[0] - 1) < _BORDER:
        fits = False
    if not fits:
        raise CaptureError(
            item.photo, "", f"the photo is {width} × {height} pixels, but {source.name} says "
            f"{told[0]} × {told[1]}", "give the photos that the cameras were solved with",
        )  # fmt: skip
    across, down = width / told[0], height / told[1]
    return replace(
        intrinsics, width=width, height=height, fx=intrinsics.fx * across, fy=intrinsics.fy * down,
        cx=intrinsics.cx * across, cy=intrinsics.cy * down,
    ), True  # fmt: skip


def _usable(points: np.ndarray | None) -> np.ndarray | None:
    if points is None or len(points) == 0:
        return None
    points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1) & (np.abs(points) < 1e12).all(axis=1)]
    return points if len(points) else None


def _unique_name(file_name: str, taken: set[str]) -> str:
    """A name for output files: the photo's stem, numbered if it is taken."""
    stem = file_name
    for extension in EXTENSIONS:
        if stem.lower().endswith(extension):
            stem = stem[: -len(extension)]
    stem = on_windows(re.sub(r"[^\w.\-]+", "_", stem).strip("._")[:80]) or "photo"
    name, number = stem, 2
    while name.lower() in taken:
        name, number = f"{stem}_{number}", number + 1
    taken.add(name.lower())
    return name


def _same_places(cameras: list[Camera]):
    seen: dict[bytes, str] = {}
    for camera in cameras:
        key = np.round(camera.camera_to_world, 6).tobytes()
        if key in seen:
            yield f"{camera.name} and {seen[key]} have the same pose"
        seen[key] = camera.name
