"""Start, resume and cancel a reconstruction."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..nmf_addon import preferences
from ..nmf_addon.jobs.create import create_job, new_job_root
from ..nmf_addon.jobs.monitor import monitor
from ..nmf_addon.runtime import RuntimeMissing, solver_python
from ..nmf_addon.scene.capture_collection import active_capture
from ..solver.capture.errors import CaptureError
from ..solver.job.folder import JobError, JobFolder


class NMF_OT_reconstruct(bpy.types.Operator):
    """Find mesh, materials and light from the photos, in the background"""

    bl_idname = "nmf.reconstruct"
    bl_label = "Reconstruct"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """With a capture and no job running."""
        cls.poll_message_set("A job is running" if monitor.running else "Import a capture first")
        return not monitor.running and active_capture(context) is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Write the job and start it."""
        settings, collection = context.scene.nmf, active_capture(context)
        try:
            python = solver_python(preferences.chosen_python())
            job = create_job(
                collection, new_job_root(collection.name), preset=settings.preset,
                device=settings.device, seed=settings.seed,
                time_limit=60 * settings.time_limit if settings.use_time_limit else None,
            )  # fmt: skip
            monitor.start(python, job)
        except (CaptureError, JobError, RuntimeMissing, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        settings.job, settings.capture = str(job.root), collection
        return {"FINISHED"}


class NMF_OT_resume(bpy.types.Operator):
    """Go on with the last job from its checkpoint"""

    bl_idname = "nmf.resume"
    bl_label = "Resume"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """With a job that does not run."""
        cls.poll_message_set("There is no job to go on with")
        return not monitor.running and bool(context.scene.nmf.job)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the job again."""
        try:
            job = JobFolder.open(Path(bpy.path.abspath(context.scene.nmf.job)))
            monitor.start(solver_python(preferences.chosen_python()), job)
        except (JobError, RuntimeMissing, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class NMF_OT_cancel(bpy.types.Operator):
    """Stop the job; what is done so far is kept to go on from"""

    bl_idname = "nmf.cancel"
    bl_label = "Cancel"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """With a job running."""
        return monitor.running

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Ask the job to stop."""
        monitor.cancel()
        return {"FINISHED"}


classes = (NMF_OT_reconstruct, NMF_OT_resume, NMF_OT_cancel)
