"""Watches the running job from a timer: drains its events, redraws the panel, installs the result."""

from __future__ import annotations

import logging
from pathlib import Path

import bpy

from ...solver.job.folder import JobError, JobFolder
from ..names import BASE_PACKAGE
from ..runtime import bootstrap_script, clean_environment
from .model import JobModel
from .process import JobProcess, start_job

INTERVAL = 0.2  # seconds
_log = logging.getLogger(BASE_PACKAGE)


class Monitor:
    """The job of this Blender; one at a time."""

    def __init__(self) -> None:
        self.process: JobProcess | None = None
        self.model = JobModel(state="new", text="")
        self.job: JobFolder | None = None

    @property
    def running(self) -> bool:
        """True while the solver works."""
        return self.process is not None

    def start(self, python: Path, job: JobFolder) -> None:
        """Start or resume a job.

        Raises:
            JobError: another job is running.
        """
        if self.running:
            raise JobError(f"{self.job.root}: a job is running; cancel it first.")
        self.process = start_job(python, bootstrap_script(), job, clean_environment())
        self.job, self.model = job, JobModel()
        bpy.app.timers.register(_tick, first_interval=INTERVAL, persistent=True)

    def cancel(self) -> None:
        """Ask the job to stop."""
        if self.process is not None:
            self.model.text = "Cancelling…"
            self.process.cancel()
            redraw_panels()

    def tick(self) -> float | None:
        """Take in what happened; the seconds until the next call, or None at the end."""
        process = self.process
        if process is None:
            return None
        changed = False
        for event in process.messages():
            changed |= self.model.apply(event)
        process.escalate()
        code = process.exit_code
        if code is not None:
            self.model.ended(code, process.log_tail())
            process.close()
            self.process = None
            changed = True
            if code == 0:
                self._install()
        if changed:
            redraw_panels()
        return INTERVAL if self.process is not None else None

    def _install(self) -> None:
        """Install the result by its operator, so that one Undo takes it back."""
        window = (
            bpy.context.window_manager.windows[0] if bpy.context.window_manager.windows else None
        )
        try:
            if window is None:
                return
            with bpy.context.temp_override(window=window):
                if bpy.context.mode != "OBJECT":
                    self.model.text = "Done; leave Edit Mode and press Install Result"
                    return
                bpy.ops.nmf.install_result(job=str(self.job.root))
        except RuntimeError as error:
            _log.exception("installing the result failed")
            self.model.state, self.model.error = "failed", str(error)

    def shut_down(self) -> None:
        """Blender quits or the extension is disabled: hang up on the child."""
        if bpy.app.timers.is_registered(_tick):
            bpy.app.timers.unregister(_tick)
        if self.process is not None:
            self.process.close()
            self.process = None


monitor = Monitor()


def _tick() -> float | None:
    return monitor.tick()


def redraw_panels() -> None:
    """Redraw the 3D Views' sidebars."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


def unregister() -> None:
    """Stop watching."""
    monitor.shut_down()
