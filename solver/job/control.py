"""What a running job hears: cancel on stdin, by file or by signal, and the end of its parent."""

import json
import os
import signal
import stat
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from ..streams import say
from .exit_codes import CANCELLED
from .standard_input import next_bytes


class Cancelled(Exception):
    """The work was asked to stop, and did."""


class Control:
    """Watches the `cancel` file, signals and Ctrl-C; and stdin, where a parent may speak.

    A line {"cmd": "cancel"} (or just `cancel`) asks the job to stop with a checkpoint; so do the file,
    SIGTERM (what a farm sends; on Windows it is Ctrl-Break), SIGHUP (a terminal that was closed; under
    nohup it is left ignored) and Ctrl-C, which ends it at once if it comes again. The end of a stdin that
    was open at the start means that the parent is gone: the job has `GRACE` seconds for a checkpoint, then
    the process ends wherever it is (files are renamed into place, so none is half written). A stdin that
    is a terminal, a file, or at its end from the beginning (but for lines that are no commands) is no
    parent: the job runs detached.

    Args:
        cancel_path: the job's `cancel` file.
        has_parent: stdin, if it is a pipe, is a parent's; else it is left alone, for it may be a list
            that a shell's loop reads.
    """

    INTERVAL = 0.25
    ENDED_AT_START = 0.05  # seconds
    GRACE = 0.8  # seconds

    def __init__(self, cancel_path: Path, has_parent: bool = True):
        self.cancelled = False
        self.parent_gone = False
        self._cancel_path = cancel_path
        self._has_parent = has_parent
        self._stop = threading.Event()
        self._beat: Callable[[], None] | None = None
        self._handlers: dict[int, Any] = {}
        self._terminals: list[int] = []

    def start(self, beat: Callable[[], None] | None = None) -> None:
        """Start watching.

        Args:
            beat: called four times a second from a thread of its own, to say that the job is alive.
        """
        self._beat = beat
        threading.Thread(target=self._watch_file, daemon=True).start()
        if threading.current_thread() is threading.main_thread():
            handlers = {signal.SIGTERM: self._on_terminate, signal.SIGINT: self._on_interrupt}
            if hasattr(signal, "SIGBREAK"):
                handlers[signal.SIGBREAK] = self._on_terminate
            if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
                self._terminals = [number for number in (1, 2) if os.isatty(number)]
                handlers[signal.SIGHUP] = self._on_hang_up
            for number, handler in handlers.items():
                self._handlers[number] = signal.signal(number, handler)
        if self._has_parent and _stdin_is_pipe():
            threading.Thread(target=self._watch_stdin, daemon=True).start()

    def stop(self) -> None:
        """Stop watching the file and signals."""
        self._stop.set()
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        self._handlers = {}

    @property
    def should_stop(self) -> bool:
        """True once the job should write its checkpoint and end."""
        return self.cancelled or self.parent_gone

    def _on_terminate(self, number: int, frame: object) -> None:
        self.cancelled = True

    def _on_hang_up(self, number: int, frame: object) -> None:
        self.cancelled = True
        # Writing to a terminal that is gone is an error, which must not cost the checkpoint.
        nowhere = os.open(os.devnull, os.O_WRONLY)
        for terminal in self._terminals:
            os.dup2(nowhere, terminal)
        os.close(nowhere)

    def _on_interrupt(self, number: int, frame: object) -> None:
        self.cancelled = True
        before = self._handlers[number]
        signal.signal(signal.SIGINT, before if callable(before) else signal.default_int_handler)

    def _watch_file(self) -> None:
        while not self._stop.wait(self.INTERVAL):
            if self._beat is not None:
                self._beat()
            with suppress(OSError):  # a network drive that is away for a moment
                self.cancelled = self.cancelled or self._cancel_path.exists()

    def _watch_stdin(self) -> None:
        opened = time.monotonic()
        heard, passed_over, rest = False, False, b""
        while True:
            data = next_bytes(sys.stdin.fileno())
            if not data:
                self.parent_gone = heard or time.monotonic() - opened > self.ENDED_AT_START
                if self.parent_gone:
                    say("Standard input was closed: whoever started this job is gone, so it stops.")
                    time.sleep(self.GRACE)
                    os._exit(CANCELLED)
                return
            *lines, rest = (rest + data).split(b"\n")
            for line in lines:
                command = _command(line.decode("utf-8", "replace"))
                heard = heard or command is not None
                self.cancelled = self.cancelled or command == "cancel"
                if command is None and not passed_over:
                    passed_over = True
                    say("Standard input is read for commands; other lines are ignored.")


def _command(line: str) -> str | None:
    if line.strip().lower() == "cancel":
        return "cancel"
    try:
        message = json.loads(line)
    except ValueError:
        return None
    command = message.get("cmd") if isinstance(message, dict) else None
    return command if isinstance(command, str) else None


def _stdin_is_pipe() -> bool:
    try:
        mode = os.fstat(sys.stdin.fileno()).st_mode
    except (AttributeError, OSError, ValueError):
        return False
    return stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode)
