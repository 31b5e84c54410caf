"""A solver process and its messages. No bpy in here: the panel and headless runs share it."""

from __future__ import annotations

import os
import queue
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from ...solver.job.events import Event, parse_event
from ...solver.job.folder import JobFolder

TERMINATE_AFTER, KILL_AFTER = 5.0, 10.0  # seconds after Cancel
LOG_LINES = 20


class JobProcess:
    """A child process that works on a job folder.

    A thread reads its events; nothing here touches Blender.

    Args:
        command: the child's command line. job: the folder it works on. environment: its variables.
    """

    def __init__(self, command: list[str], job: JobFolder, environment: dict[str, str]):
        self.job = job
        self.cancel_asked_at: float | None = None
        self._events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._log = job.log_path.open("ab")
        extra: dict = {"start_new_session": True}
        if os.name == "nt":
            extra = {
                "creationflags": subprocess.CREATE_NEW_PROCESS_GROUP | subprocess.CREATE_NO_WINDOW
            }
        self.popen = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._log,
            cwd=job.root, env=environment, **extra,
        )  # fmt: skip
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        for line in self.popen.stdout:
            self._events.put(parse_event(line.decode("utf-8", "replace")))

    def messages(self, most: int = 200) -> list[Event]:
        """Events that arrived since the last call, at most `most`."""
        events = []
        while len(events) < most:
            try:
                events.append(self._events.get_nowait())
            except queue.Empty:
                break
        return events

    @property
    def exit_code(self) -> int | None:
        """The exit code once the process has ended and all its events were handed out."""
        code = self.popen.poll()
        if code is None or self._reader.is_alive() or not self._events.empty():
            return None
        return code

    def cancel(self) -> None:
        """Ask the child to stop; `escalate` sees to it that it does."""
        if self.cancel_asked_at is None:
            self.cancel_asked_at = time.monotonic()
            try:
                self.popen.stdin.write(b'{"cmd": "cancel"}\n')
                self.popen.stdin.flush()
            except OSError:
                self.escalate()

    def escalate(self) -> None:
        """After Cancel: terminate, then kill a child that does not listen. Call regularly."""
        if self.cancel_asked_at is None or self.popen.poll() is not None:
            return
        waited = time.monotonic() - self.cancel_asked_at
        if waited > KILL_AFTER:
            self._signal(getattr(signal, "SIGKILL", signal.SIGTERM))
        elif waited > TERMINATE_AFTER:
            self._signal(signal.SIGTERM)

    def _signal(self, number: int) -> None:
        try:
            if os.name == "nt":
                self.popen.kill()
            else:
                os.killpg(self.popen.pid, number)
        except (OSError, ProcessLookupError):
            return

    def close(self) -> None:
        """Hang up: the child notices that its parent is gone, writes a checkpoint and ends."""
        for stream in (self.popen.stdin, self._log):
            try:
                stream.close()
            except OSError:
                continue

    def log_tail(self) -> str:
        """The last lines of the child's log."""
        try:
            text = self.job.log_path.read_text(encoding="utf-8", errors="replace")
        except OSError:
            return ""
        return "\n".join(text.splitlines()[-LOG_LINES:])


def start_job(
    python: Path, bootstrap: Path, job: JobFolder, environment: dict[str, str]
) -> JobProcess:
    """Start the solver on a job folder (new or to be resumed)."""
    command = [
        str(python),
        "-I",
        "-u",
        "-X",
        "utf8",
        str(bootstrap),
        "run",
        str(job.root),
        "--events",
    ]
    return JobProcess(command, job, environment)


def run_blocking(process: JobProcess, on_event: Callable[[Event], None], poll: float = 0.1) -> int:
    """Hand every event of a process to `on_event` until it ends; returns its exit code."""
    for event in job_messages(process, poll):
        on_event(event)
    process.close()
    return int(process.popen.returncode)


def job_messages(process: JobProcess, poll: float) -> Iterator[Event]:
    """All events of a process, in order, until it ends."""
    while process.exit_code is None:
        events = process.messages()
        yield from events
        if not events:
            process.escalate()
            time.sleep(poll)
