"""The heartbeat: `status.json` says who works on a job and how far along it is."""

import contextlib
import os
import platform
import sys
import threading
import time
from pathlib import Path
from typing import Any

from ..replacing import read_json, write_json_atomic


class Heartbeat:
    """Writes `status.json`, at most once a second unless the state changes; safe from several threads.

    States: preparing, running, finishing, done, cancelled, failed.
    """

    INTERVAL = 1.0

    def __init__(self, path: Path):
        self._path = path
        self._last = 0.0
        self._entry: dict[str, Any] = {}
        self._lock = threading.Lock()
        self._identity = {
            "pid": os.getpid(), "started": process_start_time(os.getpid()), "machine": machine(),
        }  # fmt: skip

    def update(self, state: str, step: int = 0, steps: int = 0, seconds_left: float | None = None) -> None:
        """Say that the job is alive and in `state`."""
        entry = {"state": state, "step": step, "steps": steps, "seconds_left": seconds_left}
        with self._lock:
            changed = state != self._entry.get("state")
            self._entry = entry
            if changed or self._is_due():
                self._write()

    def beat(self) -> None:
        """Say that the job is alive, whatever it is doing; a full disk is for others to tell."""
        with self._lock, contextlib.suppress(OSError):
            if self._entry and self._is_due():
                self._write()

    def _is_due(self) -> bool:
        return time.monotonic() - self._last >= self.INTERVAL

    def _write(self) -> None:
        self._last = time.monotonic()
        # A program that holds the file on Windows lets go of it before another beat.
        with contextlib.suppress(PermissionError):
            write_json_atomic(self._path, {**self._identity, "time": time.time(), **self._entry})


def read_status(path: Path) -> dict[str, Any]:
    """The last status; {} if there is none."""
    return read_json(path)


def machine() -> str:
    """Where process numbers mean something: this machine, or this container on it."""
    try:
        space = os.readlink("/proc/self/ns/pid")
    except OSError:
        space = ""
    return f"{platform.node()} {space}".strip()


def process_start_time(pid: int) -> float | None:
    """When a process started (clock ticks since boot on Linux); None where that is not known.

    Together with the pid it names a process for good: pids are used again.
    """
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        return float(fields[19])
    except (OSError, IndexError, ValueError):
        return None


def process_is_alive(status: dict[str, Any]) -> bool:
    """True if the process of a status still runs.

    On another machine, and where processes cannot be told apart by start time, a heartbeat younger than
    ten seconds counts as life, unless there is no process of that number here.
    """
    pid = status.get("pid")
    if not isinstance(pid, int) or status.get("state") in ("done", "cancelled", "failed"):
        return False
    if status.get("machine", machine()) != machine():
        return _is_fresh(status)
    started = process_start_time(pid)
    if started is not None:
        return started == status.get("started")
    if Path("/proc/self").exists() or is_gone(pid):
        return False
    return _is_fresh(status)


def is_gone(pid: int) -> bool:
    """True if there surely is no such process on this machine."""
    if sys.platform == "win32":
        return _is_gone_on_windows(pid)
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    except (OSError, OverflowError):
        return False
    return False


def _is_gone_on_windows(pid: int) -> bool:
    import ctypes

    may_wait, no_such_process = 0x100000, 87
    kernel32 = ctypes.WinDLL("kernel32", use_last_error=True)
    kernel32.OpenProcess.restype = ctypes.c_void_p
    process = kernel32.OpenProcess(may_wait, False, ctypes.c_uint32(pid))
    if not process:
        return ctypes.get_last_error() == no_such_process
    # A process that has ended lasts as long as somebody holds on to it; waiting for it is over at once.
    ended = kernel32.WaitForSingleObject(ctypes.c_void_p(process), 0) == 0
    kernel32.CloseHandle(ctypes.c_void_p(process))
    return ended


def _is_fresh(status: dict[str, Any]) -> bool:
    when = status.get("time")
    return isinstance(when, (int, float)) and time.time() - when < 10
