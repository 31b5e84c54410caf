"""A job's files: open its folder or report, copy what a question needs."""

import json
from pathlib import Path

import bpy
from bpy.types import Context, Operator

from ..nmf_addon import preferences, runtime
from ..nmf_addon.jobs.monitor import monitor
from ..nmf_addon.jobs.process import log_tail
from ..nmf_addon.scene.replace import JOB, is_of
from ..nmf_addon.scene.result import job_of_result
from ..solver import __version__
from ..solver.job.folder import JobFolder
from ..solver.job.request import JobError


class NMF_OT_open_job_folder(Operator):
    """Show the folder of the active object's job, else of the last one: mesh, textures, light and log"""

    bl_idname = "nmf.open_job_folder"
    bl_label = "Open Job Folder"

    @classmethod
    def poll(cls, context: Context) -> bool:
        cls.poll_message_set("There is no job yet")
        return bool(_installed_from(context)) or monitor.job is not None

    def execute(self, context: Context) -> set[str]:
        return _open(self, _job_meant(context).root)


class NMF_OT_open_report(Operator):
    """Show the report of the active object's job, else of the last one, in the web browser: photos next to
    renders, and numbers"""

    bl_idname = "nmf.open_report"
    bl_label = "Open Report"

    @classmethod
    def poll(cls, context: Context) -> bool:
        cls.poll_message_set("There is no finished job yet")
        is_done = monitor.job is not None and monitor.model.state == "done"
        return bool(_installed_from(context)) or is_done

    def execute(self, context: Context) -> set[str]:
        return _open(self, _job_meant(context).result_dir / "report.html")


class NMF_OT_copy_report(Operator):
    """Copy the error with the end of the log, to paste into a bug report"""

    bl_idname = "nmf.copy_report"
    bl_label = "Copy Error Report"

    @classmethod
    def poll(cls, context: Context) -> bool:
        cls.poll_message_set("There is no job yet")
        return monitor.job is not None

    def execute(self, context: Context) -> set[str]:
        context.window_manager.clipboard = error_report()
        self.report({"INFO"}, "Copied the report to the clipboard")
        return {"FINISHED"}


def error_report() -> str:
    """Versions, request, outcome and end of the log of the last job, without the person's paths."""
    job, model = monitor.job, monitor.model
    own = preferences.chosen("python")
    record = None if own else runtime.runtime_record(preferences.chosen("runtime_folder"))
    request = job.request_path
    text = "\n".join(
        [
            f"Neural Microfacet Fields {__version__}, Blender {bpy.app.version_string}",
            f"Solver: {record or 'own Python'}",
            request.read_text(encoding="utf-8", errors="replace") if request.is_file() else "",
            f"{model.state} at {100 * model.overall:.0f} % ({model.stage or 'start'}): {model.error}",
            *(f"Warning: {warning}" for warning in model.warnings),
            log_tail(job, 60),
        ]
    )
    for folder, name in (*_asked_for(job), (job.root, "JOB"), (Path.home(), "~")):
        # As it is, as JSON writes it, and as programs from elsewhere do: on Windows these differ.
        for spelling in (str(folder), folder.as_posix()):
            text = text.replace(json.dumps(spelling)[1:-1], name).replace(spelling, name)
    return text


def _asked_for(job: JobFolder) -> list[tuple[Path, str]]:
    try:
        request = job.request
    except JobError:
        return []
    named = [
        (request.photos, "PHOTOS"), (request.masks, "MASKS"), (request.ignored, "IGNORED"),
        (request.capture, "CAPTURE"),
    ]  # fmt: skip
    folders = [(Path(folder), name) for folder, name in named if folder]
    return [(folder, name) for folder, name in folders if not folder.is_relative_to(job.root)]


def _installed_from(context: Context) -> str:
    item = context.view_layer.objects.active
    return "" if item is None else str(item.get(JOB, ""))


def _job_meant(context: Context) -> JobFolder:
    """The active object's job, else the last one; also of a project that has moved since."""
    path, last = _installed_from(context), monitor.job
    if not path or (last and is_of(context.view_layer.objects.active, last)):
        return last
    return job_of_result(Path(path))


def _open(operator: Operator, path: Path) -> set[str]:
    if not path.exists():
        operator.report({"ERROR"}, f"{path}: it no longer exists")
        return {"CANCELLED"}
    bpy.ops.wm.path_open(filepath=str(path))
    return {"FINISHED"}


classes = (NMF_OT_open_job_folder, NMF_OT_open_report, NMF_OT_copy_report)
