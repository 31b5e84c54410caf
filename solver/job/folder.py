"""A reconstruction is a folder: what was asked, what happened, what came out.

    JOB/job.json  events.jsonl  status.json  log.txt  cancel  surroundings.exr
        standing.npz  masks/  checkpoint/  preview/  result/

`docs/job-folder.md` describes every file.
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
import time
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

Result = TypeVar("Result")
SCHEMA_VERSION = 1
MOST_SEED = (1 << 63) - 1
DEVICES = ("auto", "cpu", "cuda", "mps")
"""that a job may ask for"""
LEFT_BY_FILE_BROWSERS = (".ds_store", "._.ds_store", "desktop.ini", "thumbs.db")
"""what Finder and Explorer put, hidden, into a folder that somebody has looked at"""
EVEN = 1e-3
"""how far the axes of a similarity may be from square and even, as a share of their length"""


class JobError(ValueError):
    """A job folder that cannot be used; one sentence with the way out."""


@dataclass
class JobRequest:
    """What was asked of the solver (`job.json`).

    Attributes:
        capture: absolute path of the capture's folder or camera file.
        photos, masks: absolute paths of their folders, if they are not below the capture's.
        ignored: absolute path of a folder of pictures that are white where photos are to be ignored, or of
            one for all photos; None: what the camera file names, and what lies beside the photos.
        region: world box {"min": [3], "max": [3]} that holds the object, or None to find it.
        placement: similarity [4][4] from the capture's world to the one that asset.glb is to stand in,
            or None to find out which way is up.
        overrides: settings by `section.field`.
        time_limit: seconds of wall time, asset included, or None.
    """

    capture: str
    preset: str = "draft"
    device: str = "auto"
    seed: int = 0
    time_limit: float | None = None
    photos: str | None = None
    masks: str | None = None
    ignored: str | None = None
    region: dict[str, list[float]] | None = None
    placement: list[list[float]] | None = None
    overrides: dict[str, Any] = field(default_factory=dict)
    code_version: str = ""
    schema_version: int = SCHEMA_VERSION

    @classmethod
    def from_json(cls, content: Any, file: Path) -> JobRequest:
        """Parse `job.json`'s content.

        Raises:
            JobError: fields missing or of a newer schema.
        """
        if not isinstance(content, dict) or "capture" not in content:
            raise JobError(f"{file}: this is no job request (no 'capture'); start a new job.")
        version = content.get("schema_version", 1)
        if not isinstance(version, int) or version > SCHEMA_VERSION:
            raise JobError(f"{file}: the job was made by a newer version; update the solver.")
        known = {f.name for f in dataclasses.fields(cls)}
        request = cls(**{key: value for key, value in content.items() if key in known})
        wrong = request._wrong_field()
        if wrong:
            raise JobError(f"{file}: '{wrong}' is not what it should be; start a new job.")
        return request

    def check(self) -> None:
        """Make sure that a new request can be followed.

        Raises:
            JobError: it has a value of a wrong type, or one that cannot be.
        """
        wrong = self._wrong_field()
        if wrong:
            raise JobError(
                f"{wrong}: {getattr(self, wrong)!r} is not what it should be; change it."
            )

    def _wrong_field(self) -> str | None:
        """Name of the first field of a wrong type or value; None if all are good."""
        limit = self.time_limit
        good = {
            "capture": isinstance(self.capture, str) and self.capture != "",
            "preset": isinstance(self.preset, str),
            "device": isinstance(self.device, str),
            "seed": type(self.seed) is int and 0 <= self.seed <= MOST_SEED,
            "time_limit": limit is None or (_is_number(limit) and limit > 0),
            "photos": self.photos is None or isinstance(self.photos, str),
            "masks": self.masks is None or isinstance(self.masks, str),
            "ignored": self.ignored is None or isinstance(self.ignored, str),
            "region": self.region is None or _is_box(self.region),
            "placement": self.placement is None or is_similarity(self.placement),
            "overrides": isinstance(self.overrides, dict),
            "code_version": isinstance(self.code_version, str),
        }
        return next((name for name, fine in good.items() if not fine), None)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _is_box(region: Any) -> bool:
    """{"min": [3], "max": [3]} with a volume."""
    if not isinstance(region, dict):
        return False
    low, high = region.get("min"), region.get("max")
    for corner in (low, high):
        if not (isinstance(corner, list) and len(corner) == 3 and all(map(_is_number, corner))):
            return False
    return all(a < b for a, b in zip(low, high, strict=True))


def is_similarity(matrix: Any) -> bool:
    """True for rows [4][4] of a motion that turns, moves and scales evenly, and does not mirror."""
    if not (isinstance(matrix, list) and len(matrix) == 4):
        return False
    for row in matrix:
        if not (isinstance(row, list) and len(row) == 4 and all(map(_is_number, row))):
            return False
    x, y, z = (row[:3] for row in matrix[:3])
    size = math.hypot(*x)
    # A rotation's third row is the cross product of the others.
    across = [x[i - 2] * y[i - 1] - x[i - 1] * y[i - 2] for i in range(3)]
    return (
        matrix[3] == [0, 0, 0, 1]
        and size > 0
        and abs(sum(a * b for a, b in zip(x, y, strict=True))) < EVEN * size**2
        and abs(math.hypot(*y) - size) < EVEN * size
        and math.dist(across, [size * value for value in z]) < EVEN * size**2
    )


class JobFolder:
    """Paths and state of a job folder."""

    def __init__(self, root: Path | str):
        self.root = Path(root).absolute()
        self.request_path = self.root / "job.json"
        self.events_path = self.root / "events.jsonl"
        self.status_path = self.root / "status.json"
        self.log_path = self.root / "log.txt"
        self.cancel_path = self.root / "cancel"
        self.cameras_path = self.root / "cameras.json"
        self.surroundings_path = self.root / "surroundings.exr"
        self.standing_path = self.root / "standing.npz"
        self.masks_dir = self.root / "masks"
        self.checkpoint_dir = self.root / "checkpoint"
        self.preview_dir = self.root / "preview"
        self.result_dir = self.root / "result"
        self.manifest_path = self.result_dir / "manifest.json"

    @classmethod
    def create(
        cls, root: Path | str, request: JobRequest, may_hold: Collection[str] = ()
    ) -> JobFolder:
        """A new job in a new or empty folder.

        Args:
            may_hold: as in `check_new`.

        Raises:
            JobError: the folder holds something already, and nothing in it is touched; or the request
                has a value that cannot be.
        """
        job = cls.check_new(root, may_hold)
        request.check()
        job.root.mkdir(parents=True, exist_ok=True)
        job.ask(request)
        return job

    def ask(self, request: JobRequest) -> None:
        """Write what is asked of the solver."""
        write_json_atomic(self.request_path, dataclasses.asdict(request))

    @classmethod
    def check_new(cls, root: Path | str, may_hold: Collection[str] = ()) -> JobFolder:
        """A folder that a new job may be created in; nothing is written.

        Args:
            may_hold: names of what may lie there already.

        Raises:
            JobError: it holds something else.
        """
        job = cls(root)
        if job.root.exists() and not job.root.is_dir():
            raise JobError(f"{job.root}: this is a file; give a folder for the job.")
        if job.request_path.exists():
            state = "finished" if job.is_complete() else "unfinished"
            raise JobError(
                f"{job.root}: there is a{'n' if state[0] == 'u' else ''} {state} job in this folder; "
                "continue it with --resume or give another folder."
            )
        if job.root.is_dir() and not holds_nothing(job.root, may_hold):
            raise JobError(
                f"{job.root}: the folder is not empty and holds no job; give a new folder."
            )
        return job

    @classmethod
    def open(cls, root: Path | str) -> JobFolder:
        """An existing job.

        Raises:
            JobError: there is none.
        """
        job = cls(root)
        if not job.request_path.is_file():
            raise JobError(f"{job.root}: there is no job in this folder (no job.json).")
        return job

    @property
    def request(self) -> JobRequest:
        """What was asked."""
        try:
            content = json.loads(read_replaced(self.request_path))
        except (OSError, ValueError) as error:
            raise JobError(f"{self.request_path}: it cannot be read ({error}).") from error
        return JobRequest.from_json(content, self.request_path)

    def is_complete(self) -> bool:
        """True if the result is: its manifest is written last."""
        return self.manifest_path.is_file()

    def has_checkpoint(self) -> bool:
        """True if there is a state to resume from, be it the last but one (see `set_aside`)."""
        folders = self.checkpoint_dir, set_aside(self.checkpoint_dir)
        return any((folder / "state.json").is_file() for folder in folders)

    def manifest(self) -> dict[str, Any]:
        """The result's manifest.

        Raises:
            JobError: there is no complete result.
        """
        try:
            content = json.loads(read_replaced(self.manifest_path))
        except FileNotFoundError as error:
            if not self.request_path.is_file():
                raise JobError(
                    f"{self.root}: this is no job folder; choose the folder of one job."
                ) from error
            raise JobError(
                f"{self.root}: the job has no complete result yet; resume it."
            ) from error
        except (OSError, ValueError) as error:
            raise JobError(
                f"{self.manifest_path}: it cannot be read ({error}); run the job again."
            ) from error
        if not isinstance(content, dict):
            raise JobError(f"{self.manifest_path}: this is no manifest; run the job again.")
        return content

    def write_manifest(self, content: dict[str, Any]) -> None:
        """Declare the result complete."""
        write_json_atomic(self.manifest_path, {"schema_version": SCHEMA_VERSION, **content})


def overrides_of(texts: Iterable[str]) -> dict[str, str]:
    """What was written after `--set`, as `JobRequest.overrides`.

    Raises:
        JobError: one is no "section.field=value".
    """
    overrides = {}
    for text in texts:
        key, separator, value = text.partition("=")
        if not separator:
            raise JobError(f"--set {text}: write it as section.field=value.")
        overrides[key] = value
    return overrides


def holds_nothing(folder: Path, besides: Collection[str] = ()) -> bool:
    """True for a folder that people call empty, whatever file browsers have left in it.

    Args:
        besides: names that do not count either.
    """
    names = (entry.name for entry in folder.iterdir() if entry.name not in besides)
    return all(name.lower() in LEFT_BY_FILE_BROWSERS for name in names)


def set_aside(folder: Path) -> Path:
    """Where a folder is while another takes its place; it stays there if the process ends meanwhile."""
    return folder.with_name(f"{folder.name}.old")


def write_json_atomic(path: Path, content: Any) -> None:
    """Write JSON beside the target, then rename: readers see the old or the new, never half."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        part.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
        replace_file(part, path)
    except (OSError, ValueError):
        part.unlink(missing_ok=True)
        raise


def replace_file(source: Path, target: Path) -> None:
    """`os.replace`, patient with Windows, where nothing is replaced that a reader or a virus scanner holds.

    A folder is held by any of its files, and longer.
    """
    _patiently(lambda: os.replace(source, target), 10.0 if source.is_dir() else 1.0)


def read_replaced(path: Path) -> str:
    """The text of a file that may be replaced just now; Windows lets nobody open it in that moment."""
    return _patiently(lambda: path.read_text(encoding="utf-8"), 0.1)


def _patiently(work: Callable[[], Result], seconds: float) -> Result:
    """What `work` returns, tried again for some time while it is denied access."""
    end = time.monotonic() + seconds
    while True:
        try:
            return work()
        except PermissionError:
            if time.monotonic() > end:
                raise
            time.sleep(0.02)
