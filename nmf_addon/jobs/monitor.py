"""Watches the running job from a timer: drains events, redraws the panel, installs the result."""

import logging
import os
from collections.abc import Callable
from pathlib import Path

import bpy
from bpy.app.handlers import persistent

from ...solver.job.folder import JobFolder
from ...solver.job.request import JobError
from .. import thumbnails
from ..callbacks import detach, start_timer, stop_timer
from ..names import BASE_PACKAGE
from ..redraw import is_rendering, redraw_panels
from ..reports import reason_of
from ..runtime import bootstrap_script, clean_environment
from ..scene.images import stored_path
from ..scene.replace import installed_before
from .model import JobModel, model_of_folder
from .process import JobProcess, start_job, take_in

INTERVAL = 0.2  # seconds
LOOK_AGAIN = 3.0  # seconds between looks at a job that another process works on
SILENCE = 60.0  # seconds without news before the panel says so
WAITS = "its object is not in the scene yet; leave Edit Mode or let the render finish first"
NOT_NOW = "can't modify blend data in this state"  # what Blender says of an operator while it draws
_log = logging.getLogger(BASE_PACKAGE)


class Watcher:
    """Watches a process of the solver's from a timer.

    Attributes:
        process: None while none works.
        model: what is known of it, or of the last one.
    """

    def __init__(self) -> None:
        self.process: JobProcess | None = None
        self.model = JobModel(state="new", text="")

    @property
    def running(self) -> bool:
        return self.process is not None

    def cancel(self) -> None:
        if self.process is not None:
            self.process.cancel()
            self.model.cancelling = True
            redraw_panels()

    def hang_up(self, tick: Callable[[], float | None]) -> None:
        """Blender quits or the extension is disabled: no longer watch by `tick`, nor hold the child."""
        stop_timer(tick)
        if self.process is not None:
            self.process.close()
            self.process = None


class Monitor(Watcher):
    """The job of this Blender; one at a time.

    Attributes:
        job: the job that runs or ran last, or that the open file names.
        waits_to_install: its result is complete, but Blender was in Edit Mode or the like.
        of_this_file: False once another .blend was opened while the job ran: its result is not put
            into a file it does not belong to.
    """

    def __init__(self) -> None:
        super().__init__()
        self.job: JobFolder | None = None
        self.waits_to_install = False
        self.of_this_file = True

    @property
    def silent_for(self) -> float:
        """Seconds without news from the solver once that is worth telling, else 0."""
        quiet = 0.0 if self.process is None else self.process.silent_for
        return quiet if quiet > SILENCE else 0.0

    def start(self, python: Path, job: JobFolder) -> None:
        """Start or resume a job.

        Raises:
            JobError: another job is running, or its result waits to be installed.
            OSError: the Python cannot be started.
        """
        if self.running:
            raise JobError(f"{self.job.root}: a job is running; cancel it first.")
        if self.waits_to_install:
            raise JobError(f"{self.job.root}: {WAITS}.")
        self.process = start_job(python, bootstrap_script(), job, clean_environment())
        self.job, self.model = job, JobModel(resumable=job.has_checkpoint())
        self.of_this_file = True
        thumbnails.show(job.preview_dir / "render.png")
        start_timer(_tick, INTERVAL)

    def tick(self) -> float | None:
        """Take in what happened; the seconds until the next call, or None at the end."""
        if self.process is not None:
            self._listen()
        if self.waits_to_install and self._may_install():
            self._install()
        if self.running or self.waits_to_install:
            return INTERVAL
        if self.model.state == "elsewhere":
            if model_of_folder(self.job).state != "elsewhere":
                self.look_at(str(self.job.root))
            redraw_panels()
        return LOOK_AGAIN if self.model.state == "elsewhere" else None

    def _listen(self) -> None:
        silent, preview = self.silent_for > 0, self.model.preview_version
        _, changed, code = take_in(self.process, self.model)
        if self.model.preview_version != preview:
            thumbnails.show(self.job.preview_dir / "render.png")
        if code is not None:
            self.model.resumable = self.job.has_checkpoint()
            self.process = None
            if code == 0 and self.of_this_file:
                self.waits_to_install = True
            elif code == 0:
                self.model.text = "Done, but another file was opened; use Install Result"
        if changed or silent:
            redraw_panels()

    def _may_install(self) -> bool:
        """True in Object Mode while nothing else is under way; else says what it waits for."""
        windows = bpy.context.window_manager.windows
        if not windows:
            return bpy.app.background
        with bpy.context.temp_override(window=windows[0]):
            in_object_mode = bpy.context.mode == "OBJECT"
        wait = ""
        if is_rendering():
            # Frames, or objects, that are still to come would have another light than those before.
            wait = "the render or bake is over"
        elif any(_is_moving_something(window) for window in windows):
            wait = "nothing is being moved"
        elif not in_object_mode:
            wait = "you are in Object Mode"
        text = f"Done; the object will be added once {wait}"
        if wait and self.model.text != text:
            self.model.text = text
            redraw_panels()
        return not wait

    def _install(self) -> None:
        """Install the result by its operator, so that one Undo takes it back."""
        self.waits_to_install = False
        try:
            _install_result(self.job)
        except RuntimeError as error:
            if NOT_NOW in str(error):
                # It draws, or a render has just begun, which a timer is not told.
                self.waits_to_install = True
                return
            _log.error("installing %s failed: %s", self.job.root, error)
            self.model.state, self.model.text = "failed", "The result could not be installed"
            self.model.error = reason_of(error)
        redraw_panels()

    def look_at(self, folder: str) -> None:
        """Take up the job that a file names, if none runs: done, cancelled, failed or lost."""
        if self.running:
            return
        self.job, self.model = None, JobModel(state="new", text="")
        self.waits_to_install = False
        thumbnails.clear()
        job = JobFolder(bpy.path.abspath(folder)) if folder else None
        # False also of a folder that may not be looked into, where a path's own `is_file` raises.
        if job is not None and os.path.isfile(job.request_path):
            self.job, self.model = job, model_of_folder(job)
            thumbnails.show(job.preview_dir / "render.png")
            if self.model.state == "elsewhere":
                start_timer(_tick, INTERVAL)
            self.tell_where()

    def tell_where(self) -> None:
        """Say of a job that is done where its object is, which Undo and Redo change."""
        if self.model.state == "done" and not self.waits_to_install:
            self.model.text = _where(self.job)

    def is_named_by_file(self) -> bool:
        """True if a scene of the open .blend says that the job is its own."""
        named = [bpy.path.abspath(scene.nmf.job) for scene in _scenes_with_jobs()]
        return self.job is not None and any(Path(path) == self.job.root for path in named)

    def shut_down(self) -> None:
        """Blender quits or the extension is disabled: hang up on the child."""
        self.hang_up(_tick)
        self.look_at("")


monitor = Monitor()


def _scenes_with_jobs() -> list[bpy.types.Scene]:
    """The file's own scenes that name a job, that of the context first."""
    scenes = (scene for scene in bpy.data.scenes if scene.nmf.job and not scene.library)
    return sorted(scenes, key=lambda scene: scene != bpy.context.scene)


def _job_of_file() -> str:
    return next((scene.nmf.job for scene in _scenes_with_jobs()), "")


def _install_result(job: JobFolder) -> None:
    windows = bpy.context.window_manager.windows
    with bpy.context.temp_override(window=windows[0] if windows else None):
        # True: an operator called from Python makes no undo step of its own accord.
        bpy.ops.nmf.install_result("EXEC_DEFAULT", True, job=str(job.root))


def _where(job: JobFolder) -> str:
    """That a job is done, and where its object is if the person looks at another scene, or how it comes."""
    windows = bpy.context.window_manager.windows
    scene = windows[0].scene if windows else bpy.context.scene
    item = installed_before(job, scene)
    if item is None:
        return "Done; press Install Result to add its object"
    there = item.users_scene
    return "Done" if scene in there else f"Done; its object is in the scene {there[0].name}"


def _is_moving_something(window: bpy.types.Window) -> bool:
    """True between G, R or S and the click that ends it: what is selected has to stay so."""
    steps = [step for o in window.modal_operators for step in (o, *o.macros)]
    return any(step.bl_idname.startswith("TRANSFORM_OT_") for step in steps)


def _tick() -> float | None:
    try:
        return monitor.tick()
    except Exception:
        monitor.waits_to_install = False
        lose_sight(monitor, "the job")
        return None


def _look_at_open_file() -> None:
    monitor.look_at(_job_of_file())
    redraw_panels()


@persistent
def _on_load(path: str) -> None:
    monitor.of_this_file = monitor.is_named_by_file()
    monitor.look_at(_job_of_file())


@persistent
def _on_undo(scene: bpy.types.Scene) -> None:
    monitor.tell_where()


@persistent
def _before_save(path: str) -> None:
    """Paths of jobs hold from where the file will be, whatever Undo or Save As did to them."""
    if monitor.running and monitor.of_this_file and not monitor.is_named_by_file():
        bpy.context.scene.nmf.job = str(monitor.job.root)
    _jobs.clear()
    for scene in _scenes_with_jobs():
        _jobs[scene.name] = Path(bpy.path.abspath(scene.nmf.job))
    _store_jobs(path)


@persistent
def _after_save(path: str) -> None:
    """What was saved may have been a copy, or nothing: paths of jobs hold from the open file again."""
    _store_jobs(bpy.data.filepath)


_jobs: dict[str, Path] = {}
"""the scenes' jobs, while the file is saved"""


def _store_jobs(blend: str) -> None:
    for scene in _scenes_with_jobs():
        job = _jobs.get(scene.name)
        if job is None:
            continue
        beside = blend and job.is_relative_to(Path(blend).parent)
        stored = stored_path(job, blend) if beside else str(job)
        if scene.nmf.job != stored:
            scene.nmf.job = stored


def lose_sight(watcher, what: str) -> None:
    """Hang up on the process of a monitor or side task whose `tick` failed.

    A timer that raises is dropped in silence, and the panel would say "running" for ever.
    """
    _log.exception("watching %s failed", what)
    if watcher.process is not None:
        watcher.process.close()
    watcher.process = None
    watcher.model.state, watcher.model.text = "lost", f"Blender lost track of {what}"


def _handlers() -> list[tuple[list, Callable]]:
    at = bpy.app.handlers
    return [
        (at.load_post, _on_load), (at.save_pre, _before_save), (at.save_post, _after_save),
        (at.save_post_fail, _after_save), (at.undo_post, _on_undo), (at.redo_post, _on_undo),
    ]  # fmt: skip


def register() -> None:
    """Watch for files being opened and saved."""
    for handlers, handler in _handlers():
        handlers.append(handler)
    if not bpy.app.background:
        # At Blender's start there is no file yet that could be looked at.
        bpy.app.timers.register(_look_at_open_file, first_interval=0.0)


def unregister() -> None:
    for handlers, handler in _handlers():
        detach(handler, handlers)
    stop_timer(_look_at_open_file)
    monitor.shut_down()
