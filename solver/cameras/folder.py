"""The folder of a solve: what was asked, and whether it may be written to or continued.

    FOLDER/solve.json  database.db  sparse/0/  points.ply  transforms_train.json
           events.jsonl  status.json  cancel  photos/ (those of a video)

The database numbers the photos (`000001.png` is the first of solve.json's list) and holds them at the size
at which features were found; sparse/0 and transforms_train.json name and size them as they are.
"""

import dataclasses
import json
import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from ..capture.archives import check_unpacked
from ..capture.errors import CaptureError
from ..capture.files import no_access
from ..capture.image_header import FORMATS, developed
from ..capture.photo_finder import PhotoFinder, capture_folder
from ..capture.picture_names import VIDEOS, numbered, stem_of
from ..job.folder import holds_nothing
from ..replacing import read_json, write_json_atomic

MATCHERS = ("auto", "exhaustive", "sequential")
CAMERA_MODELS = (
    "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV", "OPENCV_FISHEYE",
)  # fmt: skip
FEWEST_PHOTOS = 3
VIDEO_PHOTOS, MOST_VIDEO_PHOTOS = 100, 1000
"""photos that are taken from a video, if nobody says how many, and at most"""
_OF_VIDEO_PHOTOS = "changed", "video_photos"
"""those that say which photos are taken from a video"""


@dataclass(frozen=True)
class SolveRequest:
    """What was asked of a solve.

    Attributes:
        photos: absolute path of the folder of photos, or of a video.
        names: the photos relative to it, in the order in which they were taken, as far as names tell; of
            a video none, until they are taken from it.
        changed: when each photo, or the video, was last written, nanoseconds; what was found in another is
            not its own.
        masks: absolute path of a folder of masks; features are taken from what they show. Or None.
        ignored: absolute path of a folder of pictures that are white where photos are to be ignored, or of
            one for all photos; None: those that lie beside the photos.
        masks_changed, ignored_changed: as `changed`, of each photo's mask and of its picture of what is to
            be ignored, None where it has none; () if no photo has one. Of a video, of the one for all.
        video_photos: how many to take from a video; 0 for a folder.
        max_image_size: longest side at which features are found, pixels.
    """

    photos: str
    names: tuple[str, ...]
    changed: tuple[int, ...] = ()
    matcher: str = "auto"
    camera_model: str = "OPENCV"
    sharing: str = "auto"
    masks: str | None = None
    ignored: str | None = None
    masks_changed: tuple[int | None, ...] = ()
    ignored_changed: tuple[int | None, ...] = ()
    video_photos: int = 0
    max_image_size: int = 1600
    max_features: int = 4096
    seed: int = 0


class SolveFolder:
    """Paths of a solve's folder."""

    def __init__(self, root: Path):
        self.root = Path(os.path.abspath(root))
        self.request_path = self.root / "solve.json"
        self.database_path = self.root / "database.db"
        self.sparse_dir = self.root / "sparse"
        self.video_photos_dir = self.root / "photos"
        self.points_path = self.root / "points.ply"
        self.cameras_path = self.root / "transforms_train.json"
        self.events_path = self.root / "events.jsonl"
        self.status_path = self.root / "status.json"
        self.cancel_path = self.root / "cancel"
        self.work_dir = self.root / "work"

    def begun(self) -> dict:
        """What the solve in this folder was asked; {} where nothing can be read."""
        return read_json(self.request_path)

    def take(self, request: SolveRequest) -> bool:
        """Begin a solve in this folder, or continue the same one; True if it is continued.

        An unfinished solve of the same folder with other photos or options is begun anew, and so is one
        whose photos, masks or pictures of what is to be ignored have changed: features were found in other
        ones.

        Raises:
            CaptureError: the folder holds anything else; nothing in it is touched.
        """
        asked = json.loads(json.dumps(dataclasses.asdict(request)))
        if self.root.exists() and not self.root.is_dir():
            raise CaptureError(self.root, "", "this is a file", "give a new folder for the cameras")
        if self.cameras_path.exists():
            raise CaptureError(
                self.root, "", "there are cameras in this folder already",
                "reconstruct from it, or give a new folder",
            )  # fmt: skip
        if self.request_path.exists():
            begun = self.begun()
            if begun == asked:
                return True
            if begun.get("photos") != asked["photos"]:
                raise CaptureError(
                    self.root, "", "a solve of other photos was begun here", "give a new folder"
                )
            self.drop_database()
            if any(begun.get(name) != asked[name] for name in _OF_VIDEO_PHOTOS):
                shutil.rmtree(self.video_photos_dir, ignore_errors=True)
            write_json_atomic(self.request_path, asked)
            return False
        if self.root.is_dir() and not holds_nothing(self.root):
            raise CaptureError(self.root, "", "the folder is not empty", "give a new folder")
        self.root.mkdir(parents=True, exist_ok=True)
        write_json_atomic(self.request_path, asked)
        return False

    def drop_database(self) -> None:
        """Remove the database, and what SQLite keeps beside it."""
        for path in self.root.glob(f"{self.database_path.name}*"):
            path.unlink(missing_ok=True)

    def finds_photos_of(self, photos: Path) -> bool:
        """True if reading this folder's cameras finds the photos without being told where they are."""
        folder = capture_folder(self.cameras_path)
        return photos.absolute().is_relative_to(folder)


def is_video(path: Path) -> bool:
    return path.suffix.lower() in VIDEOS and path.is_file()


def check_of_video(video: Path, masks: Path | None, ignored: Path | None) -> None:
    """Make sure that what is given with a video needs no names of its photos, which are yet to be taken.

    Args:
        masks: a folder, or None. ignored: a folder of pictures, or one for all photos, or None.

    Raises:
        CaptureError: it does.
    """
    if masks is not None:
        raise CaptureError(
            video, "masks", "a video's photos have no masks yet", "give none, or solve a folder of photos"
        )
    if ignored is not None and ignored.is_dir():
        raise CaptureError(
            ignored, "ignore", "a video's photos have no pictures there yet",
            "give one picture for all photos, or solve a folder of photos",
        )  # fmt: skip


def photos_below(
    folder: Path, besides: Path | None = None, masks: Path | None = None, ignored: Path | None = None
) -> tuple[str, ...]:
    """Names of all photos below a folder, relative to it, numbers in their order (2 before 10).

    Args:
        besides: a folder whose pictures are left out, or None. masks: that of their masks, or None.
        ignored: see `IgnoredFinder`.

    Raises:
        CaptureError: there is no such folder, it cannot be read, holds too few, or half of an archive.
    """
    if folder.is_file():
        raise CaptureError(
            folder, "", "this is not a known kind of video",
            f"give a folder of photos, or a video ({' '.join(VIDEOS)})",
        )  # fmt: skip
    if not folder.is_dir():
        raise CaptureError(folder, "", "there is no such folder", "give the folder of the photos")
    check_unpacked(folder)
    try:
        there = sorted(folder.iterdir())
    except OSError as error:  # macOS asks people which programs may read their folders
        raise no_access(folder, error) from error
    root = Path(os.path.abspath(folder))
    found = PhotoFinder(folder, masks, ignored=ignored).pictures()
    if besides is not None:
        besides = Path(os.path.abspath(besides))
        found = [path for path in found if not path.is_relative_to(besides)]
    _check_no_copies(folder, found)
    if len(found) < FEWEST_PHOTOS:
        video = next((path for path in there if is_video(path)), None)
        remedy = f"give at least {FEWEST_PHOTOS} that overlap, better 50"
        raise CaptureError(
            folder, "photos", f"it has too few photos: {len(found)} ({FORMATS})",
            remedy if video is None else f"give the video itself, {video.name}",
        )  # fmt: skip
    return tuple(sorted((path.relative_to(root).as_posix() for path in found), key=numbered))


def _check_no_copies(folder: Path, found: list[Path]) -> None:
    """Make sure that most raw and HEIC photos have no converted copies in other folders."""
    furthest = {stem_of(path.name): path for path in sorted(found, key=developed)}
    early = [path for path in found if developed(path) < 2]
    twice = [path for path in early if developed(furthest[stem_of(path.name)]) == 2]
    if 1 < len(twice) and len(early) <= 2 * len(twice):
        first, copy = twice[0].name, furthest[stem_of(twice[0].name)].name
        raise CaptureError(
            folder, "photos", f"{len(twice)} photos seem to be there twice, such as {first} and {copy}",
            "give the folder of one kind",
        )  # fmt: skip
