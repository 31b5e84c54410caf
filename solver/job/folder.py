"""A reconstruction is a folder: what was asked, what happened, what came out.

    JOB/job.json  events.jsonl  status.json  log.txt  cancel  surroundings.exr
        standing.npz  masks/  checkpoint/  preview/  result/

`docs/job-folder.md` describes every file.
"""

import dataclasses
import json
import re
from collections.abc import Collection
from pathlib import Path
from typing import Any

from ..capture.files import LEFT_BY_FILE_BROWSERS
from ..replacing import read_replaced, write_json_atomic
from .request import SCHEMA_VERSION, JobError, JobRequest

MANIFEST = "manifest.json"
"""of a result; it is written last"""
CAPTURE = "capture"
"""folder of a job with cameras that Blender wrote"""


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
        self.manifest_path = self.result_dir / MANIFEST

    @classmethod
    def create(cls, root: Path | str, request: JobRequest, may_hold: Collection[str] = ()) -> "JobFolder":
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
        write_json_atomic(self.request_path, dataclasses.asdict(request))

    @classmethod
    def check_new(cls, root: Path | str, may_hold: Collection[str] = ()) -> "JobFolder":
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
            raise JobError(f"{job.root}: the folder is not empty and holds no job; give a new folder.")
        return job

    @classmethod
    def open(cls, root: Path | str) -> "JobFolder":
        """An existing job.

        Raises:
            JobError: there is none.
        """
        job = cls(root)
        if not job.request_path.is_file():
            raise JobError(f"{job.root}: there is no job.json; give the folder of a job.")
        return job

    @property
    def request(self) -> JobRequest:
        try:
            content = json.loads(read_replaced(self.request_path))
        except (OSError, ValueError) as error:
            raise JobError(f"{self.request_path}: unreadable ({error}); start a new job.") from error
        return JobRequest.from_json(content, self.request_path)

    @property
    def capture_path(self) -> Path:
        """Where the capture is that was asked for; cameras that Blender wrote into a job move with it."""
        stated = self.request.capture
        _, folder, name = re.split(r"[/\\]", f"//{stated}")[-3:]
        own = self.root / CAPTURE / name
        has_moved = folder == CAPTURE and own.is_file() and not Path(stated).exists()
        return own if has_moved else Path(stated)

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
                raise JobError(f"{self.root}: this is not a job folder; choose one.") from error
            raise JobError(f"{self.root}: the job has no complete result yet; resume it.") from error
        except (OSError, ValueError) as error:
            raise JobError(
                f"{self.manifest_path}: it cannot be read ({error}); run the job again."
            ) from error
        if not isinstance(content, dict):
            raise JobError(f"{self.manifest_path}: this is not a manifest; run the job again.")
        return content

    def write_manifest(self, content: dict[str, Any]) -> None:
        """Declare the result complete."""
        write_json_atomic(self.manifest_path, {"schema_version": SCHEMA_VERSION, **content})


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
