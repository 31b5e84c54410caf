"""Install a finished job."""

from pathlib import Path

import bpy
from bpy.types import Context, Event, Operator

from ..nmf_addon.jobs.monitor import monitor
from ..nmf_addon.scene.install import install_result
from ..nmf_addon.scene.job_capture import capture_of_job
from ..nmf_addon.scene.result import job_of_result
from ..solver.job.request import JobError


class NMF_OT_install_result(Operator):
    """Add the object of a finished job to the scene, under its recovered light"""

    bl_idname = "nmf.install_result"
    bl_label = "Install Result"
    bl_options = {"REGISTER", "UNDO"}

    job: bpy.props.StringProperty(
        name="Job", description="Folder of the finished job, or of an exported result",
        subtype="DIR_PATH", options={"SKIP_SAVE"},
    )  # fmt: skip
    directory: bpy.props.StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})

    @classmethod
    def poll(cls, context: Context) -> bool:
        """In Object Mode: the result becomes the active object."""
        cls.poll_message_set("Switch to Object Mode first: the result becomes the active object")
        return context.mode == "OBJECT"

    def invoke(self, context: Context, event: Event) -> set[str]:
        """Ask for the folder, starting at the last job."""
        self.directory = context.scene.nmf.job
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: Context) -> set[str]:
        """Install with the capture the job was made from, else by itself."""
        stated = self.job or self.directory
        if not stated:  # of a script; the file browser has a folder
            self.report({"ERROR"}, "There is no path; give the folder of a finished job as job.")
            return {"CANCELLED"}
        folder = Path(bpy.path.abspath(stated))
        try:
            asset = install_result(context, folder, capture_of_job(context, job_of_result(folder)))
        except (JobError, RuntimeError) as error:
            if not self.job and not monitor.running and (folder / "job.json").is_file():
                monitor.look_at(str(folder))  # if it is not finished, the panel can resume it
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        monitor.tell_where()
        scenes = asset.object.users_scene
        if context.scene not in scenes:
            self.report({"INFO"}, f"Its object is in the scene {scenes[0].name}")
        if asset.moved_cameras:
            self.report({"INFO"}, f"Cameras moved to fit their photos: {asset.moved_cameras}")
        if asset.kept:
            names = ", ".join(f"'{name}'" for name in asset.kept)
            self.report({"WARNING"}, f"What you had edited stays in the file, hidden: {names}")
        return {"FINISHED"}


classes = (NMF_OT_install_result,)
