"""What the solver does besides reconstructing: solve cameras, check a capture. One at a time, by timer."""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import bpy
from bpy.app.handlers import persistent

from ...solver.job.events import Event
from ..callbacks import detach, start_timer
from ..names import BASE_PACKAGE
from ..redraw import redraw_panels
from ..reports import reason_of
from ..runtime import bootstrap_script, clean_environment
from .model import JobModel
from .monitor import INTERVAL, Watcher, lose_sight
from .process import JobProcess, solver_command, take_in

_log = logging.getLogger(BASE_PACKAGE)


class TaskError(RuntimeError):
    """Another task is running; one sentence."""


@dataclass(frozen=True)
class TaskFolder:
    """Where a task runs and writes its log."""

    root: Path

    @property
    def log_path(self) -> Path:
        """The solver's stderr."""
        return self.root / "log.txt"


class SideTask(Watcher):
    """The task that runs or ran last.

    Attributes:
        title: what it is for, in the panel.
        events: all its events so far but progress.
        started_in: the .blend that was open then; empty if none.
        of_this_file: False once another .blend was opened meanwhile: what it finds is not put there.
        holds_for: whether a capture still has what came out, which Undo takes back; None: it has none.
    """

    def __init__(self) -> None:
        super().__init__()
        self.title = ""
        self.events: list[Event] = []
        self.of_this_file = True
        self.holds_for: Callable[[bpy.types.Collection], bool] | None = None
        self._done: Callable[[SideTask], None] | None = None
        self._kept = self.started_in = ""

    def start(
        self, title: str, python: Path, words: list[str], folder: Path,
        done: "Callable[[SideTask], None]", kept: str = "",
    ) -> None:  # fmt: skip
        """Run `python -m solver WORDS` in a folder; `done` is called once it has succeeded.

        Args:
            kept: what the person can do with the result if another file was opened meanwhile.

        Raises:
            TaskError: a task is running. OSError: the Python cannot be started.
        """
        if self.running:
            raise TaskError(f"{self.title} is running; wait for it or cancel it.")
        folder.mkdir(parents=True, exist_ok=True)
        command = solver_command(python, bootstrap_script(), words)
        self.process = JobProcess(command, TaskFolder(folder), clean_environment())
        self.title, self.model, self.events, self._done = title, JobModel(), [], done
        self.of_this_file, self.holds_for, self._kept = True, None, kept
        self.started_in = bpy.data.filepath
        start_timer(_tick, INTERVAL)

    def tick(self) -> float | None:
        if self.process is None:
            return None
        events, changed, code = take_in(self.process, self.model)
        self.events += [event for event in events if event.kind != "progress"]
        if code is not None:
            self.process = None
            if code == 0 and self.of_this_file:
                self._finish()
            elif code == 0:
                text = f"{self.title} is done, but another file was opened. {self._kept}"
                self.model.text = text.strip()
        if changed:
            redraw_panels()
        return INTERVAL if self.running else None

    def _finish(self) -> None:
        windows = bpy.context.window_manager.windows
        try:
            with bpy.context.temp_override(window=windows[0] if windows else None):
                self._done(self)
        except Exception as error:  # whatever fails, the panel has to say so
            _log.exception("%s: the result could not be used", self.title)
            self.model.state, self.model.text = "failed", f"{self.title}: the result is unusable"
            self.model.error = reason_of(error)

    def shut_down(self) -> None:
        self.hang_up(_tick)
        self.__init__()


side_task = SideTask()


def _tick() -> float | None:
    try:
        return side_task.tick()
    except Exception:
        lose_sight(side_task, side_task.title)
        return None


@persistent
def _on_load(path: str) -> None:
    """A file was opened: what came out before is none of its, nor what will, if it is another."""
    side_task.of_this_file = path != "" and path == side_task.started_in
    if not side_task.running:
        side_task.model = JobModel(state="new", text="")


def register() -> None:
    bpy.app.handlers.load_post.append(_on_load)


def unregister() -> None:
    detach(_on_load, bpy.app.handlers.load_post)
    side_task.shut_down()
