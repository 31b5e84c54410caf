"""A solver process and its messages. No bpy in here: the panel and headless runs share it."""

import os
import queue
import signal
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ...solver.job.events import Event, parse_event
from ...solver.job.folder import JobFolder
from ...solver.replacing import replace_file
from .model import JobModel

TERMINATE_AFTER, KILL_AFTER = 5.0, 10.0  # seconds after Cancel
DRAIN_SECONDS = 2.0  # a grandchild may hold the pipe open after the solver's end
LOG_LINES = 20
MOST_AT_ONCE = 200
POLL = 0.1  # seconds
LOG_BYTES = 10 * 2**20  # an older log is set aside beyond this


class JobProcess:
    """A child process that works on a job folder.

    A thread reads its events; nothing here touches Blender.

    Args:
        command: the child's command line. job: the folder it works on. environment: its variables.

    Raises:
        OSError: the program cannot be started.
    """

    def __init__(self, command: list[str], job: JobFolder, environment: dict[str, str]):
        self.job = job
        self.said_bye = False
        self.cancel_asked_at: float | None = None
        self._rung = 0
        self._ended_at: float | None = None
        self._heard_at = time.monotonic()
        self._events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        with _open_log(job.log_path) as log:
            self.popen = start_group(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log,
                cwd=job.root, env=environment,
            )  # fmt: skip
        # The child hears that it has a parent, even one that is gone before it listens.
        self._tell("hello")
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        for line in self.popen.stdout:
            event = parse_event(line.decode("utf-8", "replace"))
            self._heard_at = time.monotonic()
            self.said_bye |= event.kind == "bye"
            self._events.put(event)

    def messages(self) -> list[Event]:
        """Events that arrived since the last call, not all if they are many."""
        events = []
        while len(events) < MOST_AT_ONCE:
            try:
                events.append(self._events.get_nowait())
            except queue.Empty:
                break
        return events

    @property
    def exit_code(self) -> int | None:
        """The exit code once the process has ended and all its events were handed out."""
        code = self.popen.poll()
        if code is None:
            return None
        if self._ended_at is None:
            self._ended_at = time.monotonic()
        still_reading = self._reader.is_alive()
        if still_reading and time.monotonic() - self._ended_at < DRAIN_SECONDS:
            return None
        return code if self._events.empty() else None

    @property
    def silent_for(self) -> float:
        """Seconds since the child was last heard of."""
        return time.monotonic() - self._heard_at

    def cancel(self) -> None:
        """Ask the child to stop; `escalate` sees to it that it does."""
        if self.cancel_asked_at is not None:
            return
        self.cancel_asked_at = time.monotonic()
        if not self._tell("cancel"):
            # It has hung up already: there is nobody to ask.
            self.cancel_asked_at -= TERMINATE_AFTER

    def _tell(self, word: str) -> bool:
        try:
            self.popen.stdin.write(b'{"cmd": "%s"}\n' % word.encode())
            self.popen.stdin.flush()
        except (OSError, ValueError):
            return False
        return True

    def escalate(self) -> None:
        """After Cancel: terminate, then kill a child that does not listen. Call regularly."""
        if self.cancel_asked_at is None or self.popen.poll() is not None:
            return
        waited = time.monotonic() - self.cancel_asked_at
        if waited > KILL_AFTER and self._rung < 2:
            self._rung = 2
            end_group(self.popen, kill=True)
        elif waited > TERMINATE_AFTER and self._rung < 1:
            self._rung = 1
            end_group(self.popen, kill=False)

    def close(self) -> None:
        """Hang up: the child notices that its parent is gone, writes a checkpoint and ends."""
        try:
            self.popen.stdin.close()
        except OSError:
            return


def log_tail(job: JobFolder, lines: int = LOG_LINES) -> str:
    """The last lines of a job's log; empty if there is none."""
    try:
        with job.log_path.open("rb") as file:
            file.seek(max(file.seek(0, os.SEEK_END) - 65536, 0))
            text = file.read().decode("utf-8", "replace")
    except OSError:
        return ""
    return "\n".join(text.splitlines()[-lines:])


def start_group(command: list[str], **settings: Any) -> subprocess.Popen:
    """`Popen` of a child with a process group of its own, without a console.

    Raises:
        OSError: the program, which it names, cannot be started.
    """
    if os.name == "nt":
        flags = subprocess.CREATE_NEW_PROCESS_GROUP | subprocess.CREATE_NO_WINDOW
        settings["creationflags"] = flags
    else:
        settings["start_new_session"] = True
    try:
        return subprocess.Popen(command, **settings)
    except OSError as error:
        error.filename = error.filename or command[0]  # Windows names none
        raise


def end_group(process: subprocess.Popen, kill: bool) -> None:
    """End a child of `start_group`, and its own children.

    Windows has no way to ask a process without a console: there only `kill` does anything.
    """
    if process.poll() is not None:
        return
    if os.name != "nt":
        try:
            os.killpg(process.pid, signal.SIGKILL if kill else signal.SIGTERM)
        except (ProcessLookupError, PermissionError):
            return  # it has just ended; macOS says so by the latter
    elif kill:
        command = ["taskkill", "/F", "/T", "/PID", str(process.pid)]
        hidden = subprocess.CREATE_NO_WINDOW
        try:
            subprocess.run(command, capture_output=True, check=True, creationflags=hidden)
        except (OSError, subprocess.CalledProcessError):
            process.kill()  # without its children


def solver_command(python: Path, bootstrap: Path, words: list[str]) -> list[str]:
    """`python -m solver WORDS`, deaf to what the environment says of Python."""
    return [str(python), "-I", "-u", "-X", "utf8", str(bootstrap), *words]


def start_job(python: Path, bootstrap: Path, job: JobFolder, environment: dict[str, str]) -> JobProcess:
    """Start the solver on a job folder (new or to be resumed).

    Raises:
        OSError: the Python cannot be started.
    """
    command = solver_command(python, bootstrap, ["run", str(job.root), "--events"])
    return JobProcess(command, job, environment)


def take_in(process: JobProcess, model: JobModel) -> tuple[list[Event], bool, int | None]:
    """Tell a model what a process has said since the last call; call regularly.

    Returns:
        The events, whether the model changed, and the exit code once the process has ended; it is
        closed then.
    """
    events, changed = process.messages(), False
    for event in events:
        changed |= model.apply(event)
    process.escalate()
    code = process.exit_code
    if code is not None:
        model.ended(code, process.said_bye, log_tail(process.job))
        process.close()
        changed = True
    return events, changed, code


def run_blocking(process: JobProcess, on_event: Callable[[Event], None]) -> int:
    """Hand every event of a process to `on_event` until it ends; returns its exit code."""
    while process.exit_code is None:
        events = process.messages()
        for event in events:
            on_event(event)
        if not events:
            process.escalate()
            time.sleep(POLL)
    process.close()
    return int(process.popen.returncode)


def _open_log(path: Path):
    if path.is_file() and path.stat().st_size > LOG_BYTES:
        replace_file(path, path.with_name("log.old.txt"))
    return path.open("ab")
