"""Files that others read while they are replaced: they see the old or the new, never half."""

import errno
import json
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

Result = TypeVar("Result")
_LONGEST_ON_WINDOWS = 247
"""characters of a folder's path that can be made there; a file's may have twelve more"""


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


@contextmanager
def written_beside(path: Path) -> Iterator[Path]:
    """Where to write what takes a file's place once it is whole; its name ends as the file's does."""
    part = path.with_name(f"{path.stem}.part{path.suffix}")
    yield part
    replace_file(part, path)


def replace_file(source: Path, target: Path) -> None:
    """`os.replace`, patient with Windows, where nothing is replaced that a reader or a virus scanner holds.

    A folder is held by any of its files, and longer.
    """
    _patiently(lambda: os.replace(source, target), 10.0 if source.is_dir() else 1.0)


def remove_file(path: Path) -> None:
    """Remove a file that need not be there, as patiently."""
    _patiently(lambda: path.unlink(missing_ok=True), 1.0)


def read_replaced(path: Path) -> str:
    """The text of a file that may be replaced just now; Windows lets nobody open it in that moment."""
    return _patiently(lambda: path.read_text(encoding="utf-8"), 0.1)


def read_json(path: Path) -> dict[str, Any]:
    """The object of a JSON file that may be replaced just now; {} where there is none to be read."""
    try:
        content = json.loads(read_replaced(path))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def is_too_long(error: OSError) -> bool:
    """Whether a path is longer than the system takes; Windows, which takes 259 characters unless somebody
    has switched longer ones on, says that there is no such file."""
    if os.name != "nt" or error.errno != errno.ENOENT:
        return error.errno == errno.ENAMETOOLONG
    paths = (str(path) for path in (error.filename, error.filename2) if path)
    return any(len(os.path.abspath(path)) > _LONGEST_ON_WINDOWS for path in paths)


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
