"""Events: one JSON object a line, appended to `events.jsonl` and sent to the parent process."""

import json
import math
import os
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

EVENT_VERSION = 1


@dataclass(frozen=True)
class Event:
    """Something that happened. `kind` is 'log' for a line that was no event."""

    kind: str
    time: float = 0.0
    data: dict[str, Any] = field(default_factory=dict)


class EventStream:
    """Writes events; safe from several threads; a parent that hung up does not stop the job.

    Args:
        path: the job's `events.jsonl`.
        stream: where the parent listens, or None.

    Raises:
        BlockingIOError: another process writes them.
    """

    def __init__(self, path: Path, stream: TextIO | None = None):
        torn = _ends_within_a_line(path)
        self._file = path.open("a", encoding="utf-8", newline="\n")
        try:
            _lock(self._file)
        except BlockingIOError:
            self._file.close()
            raise
        if torn:
            self._file.write("\n")
        self._stream = stream
        self._lock = threading.Lock()

    def emit(self, kind: str, **data: Any) -> None:
        """Write an event. Data are numbers, strings, and file names relative to the job.

        A number that is not finite becomes null: JSON has none, and it must not end the job.
        """
        finite = {key: _finite(value) for key, value in data.items()}
        entry = {"v": EVENT_VERSION, "t": round(time.time(), 3), "ev": kind, **finite}
        line = json.dumps(entry, allow_nan=False) + "\n"
        with self._lock:
            # The parent first: it is to hear of a disk that is full.
            if self._stream is not None:
                try:
                    self._stream.write(line)
                    self._stream.flush()
                except (OSError, ValueError):
                    self._stream = None
            self._file.write(line)
            self._file.flush()

    def close(self) -> None:
        with self._lock:
            self._file.close()


def _lock(file: TextIO) -> None:
    """Hold a file alone until it is closed, where the system and the disk can; it can be read meanwhile."""
    try:
        if os.name == "nt":
            _lock_on_windows(file.fileno())
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError:  # not all network drives have locks
        pass


def _lock_on_windows(descriptor: int) -> None:
    import msvcrt

    # What is locked there cannot be read, so it is a byte that the file never has.
    os.lseek(descriptor, 1 << 30, os.SEEK_SET)
    try:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
    except PermissionError as error:
        raise BlockingIOError(*error.args) from error


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _ends_within_a_line(path: Path) -> bool:
    """True if a killed process left half a line, which the next event must not be glued to."""
    try:
        with path.open("rb") as file:
            file.seek(-1, os.SEEK_END)
            return file.read(1) != b"\n"
    except OSError:
        return False


def clock(seconds: float) -> str:
    """Seconds as people are told them: 1:05 or 2:01:05."""
    minutes, seconds = divmod(int(max(seconds, 0)), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{seconds:02d}" if hours else f"{minutes}:{seconds:02d}"


def parse_event(line: str) -> Event:
    """An event of a line; a line that is none becomes a 'log' event, never an error."""
    try:
        entry = json.loads(line)
        kind, when = entry.pop("ev"), float(entry.pop("t", 0.0))
        return Event(str(kind), when, entry)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return Event("log", 0.0, {"text": line.rstrip("\n")})


def read_events(path: Path) -> list[Event]:
    """The complete lines of an event file."""
    try:
        data = path.read_bytes()
    except OSError:
        return []
    lines = data[: data.rfind(b"\n") + 1].decode("utf-8", "replace").split("\n")
    return [parse_event(line) for line in lines if line.strip()]
