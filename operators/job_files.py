"""The last job's files: open its folder, copy a report for a question."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..nmf_addon.jobs.monitor import monitor


class NMF_OT_open_job_folder(bpy.types.Operator):
    """Show the last job's folder with report, mesh and textures"""

    bl_idname = "nmf.open_job_folder"
    bl_label = "Open Job Folder"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """With a job."""
        cls.poll_message_set("There is no job yet")
        return bool(context.scene.nmf.job)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Open it."""
        folder = Path(bpy.path.abspath(context.scene.nmf.job))
        if not folder.is_dir():
            self.report({"ERROR"}, f"{folder}: the folder is gone")
            return {"CANCELLED"}
        bpy.ops.wm.path_open(filepath=str(folder))
        return {"FINISHED"}


class NMF_OT_copy_report(bpy.types.Operator):
    """Copy what went wrong, with the end of the log, to paste into a question"""

    bl_idname = "nmf.copy_report"
    bl_label = "Copy Error Report"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """After a job."""
        return monitor.job is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Copy to the clipboard."""
        job = monitor.job
        log = job.log_path.read_text(errors="replace")[-4000:] if job.log_path.is_file() else ""
        context.window_manager.clipboard = (
            f"Blender {bpy.app.version_string}\n{job.request_path.read_text()}\n"
            f"{monitor.model.state}: {monitor.model.error}\n{log}"
        )
        self.report({"INFO"}, "Copied")
        return {"FINISHED"}


classes = (NMF_OT_open_job_folder, NMF_OT_copy_report)
