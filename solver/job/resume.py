"""Taking up a job that was begun: it has to be the one that is asked for now."""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..capture.archives import is_of_missing
from .folder import JobFolder
from .request import JobError

_PATHS = ("capture", "photos", "masks", "ignored")


def take_up(
    job: JobFolder, asked: dict[str, Any], time_limit: float | None,
    check_moved: Callable[[JobFolder], None] = lambda job: None,
) -> None:  # fmt: skip
    """Make sure that a job was begun with what is asked now; another time limit is taken over, and where
    photos and cameras lie now, if they are no longer where they were.

    Args:
        asked: fields of `JobRequest`; None where a person did not say.
        check_moved: called if photos or cameras are elsewhere; if it raises, nothing was taken over.

    Raises:
        JobError: it was begun otherwise, or the limit cannot be.
    """
    begun, changes = job.request, {}
    for name, value in asked.items():
        before = str(job.capture_path) if name == "capture" else getattr(begun, name)
        if value is None or before == value or (name in _PATHS and _same_place(before, value)):
            continue
        if name in _PATHS and before is not None and not Path(before).exists():
            changes[name] = value
            continue
        raise JobError(
            f"{job.root}: this job was begun with the {name} {before!r}, not {value!r}; resume it without "
            "other options, or give another folder."
        )
    if time_limit is not None:
        changes["time_limit"] = time_limit
    changed = dataclasses.replace(begun, **changes)
    if changed != begun:
        changed.check()
        job.ask(changed)
        try:
            if not changes.keys().isdisjoint(_PATHS):
                check_moved(job)
        except Exception:
            job.ask(begun)
            raise


def _same_place(one: str | None, other: str) -> bool:
    """Whether paths lead to the same, or one is of an archive that is there no longer."""
    if one is None:
        return False
    return Path(one).resolve() == Path(other).resolve() or is_of_missing(Path(one), Path(other))
