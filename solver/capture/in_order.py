"""Photos of camera files that name none and count on the order of their names."""

from pathlib import Path

from .errors import CaptureError
from .photo_finder import PhotoFinder
from .picture_names import folder_called


def photos_in_order(
    path: Path, field: str, count: int, folders: tuple[str, ...], photos: PhotoFinder
) -> list[Path | None]:
    """The photo of each of `count` cameras, by the order of the photos' names.

    They are all that lie in one folder: one of those called by `folders` beside the file, in this order,
    else the capture's own. A folder with more or fewer photos is not taken: nothing says which is whose.

    Args:
        path: the camera file. field: what states how many cameras there are, for errors.

    Raises:
        CaptureError: photos are wanted, and no folder has as many.
    """
    by_folder: dict[Path, list[Path]] = {}
    for picture in photos.pictures():
        by_folder.setdefault(picture.parent, []).append(picture)
    beside = path.absolute().parent
    places = [folder_called(beside, name) for name in folders] + [photos.folder]
    there = [place for place in places if place in by_folder]
    for place in there:
        if len(by_folder[place]) == count:
            return list(by_folder[place])
    if not photos.wanted:
        return [None] * count
    if not there:
        raise CaptureError(
            path, "photos", f"there are none in the folder {folders[0]} next to it",
            "put the photos there, or give their folder",
        )  # fmt: skip
    raise CaptureError(
        path, field, f"it has {count} cameras, but {there[0]} has {len(by_folder[there[0]])} photos, "
        "and nothing says which belong together",
        "leave only the photos of its cameras there, or give the cameras it was made from",
    )  # fmt: skip
