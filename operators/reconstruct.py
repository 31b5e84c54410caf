"""Start, resume and cancel a reconstruction."""

import bpy
from bpy.types import Context, Operator

from ..nmf_addon import preferences
from ..nmf_addon.jobs.create import create_job, new_job_root
from ..nmf_addon.jobs.model import model_of_folder
from ..nmf_addon.jobs.monitor import WAITS, monitor
from ..nmf_addon.properties import chosen_overrides
from ..nmf_addon.scene.capture_collection import active_capture, remember_job, shown_twice, to_capture_space
from ..nmf_addon.scene.images import stored_path
from ..nmf_addon.scene.region import region_problem
from ..solver.job.folder import JobFolder
from ..solver.job.request import JobError
from .polls import reporting

ALONE = "The job ends with this script, as there is no window; use blender -b -c nmf reconstruct"


def _busy() -> str:
    if monitor.running:
        return "A job is running"
    return f"Last job: {WAITS}" if monitor.waits_to_install else ""


class NMF_OT_reconstruct(Operator):
    """Find mesh, materials and light from the photos; you can keep working meanwhile"""

    bl_idname = "nmf.reconstruct"
    bl_label = "Reconstruct"
    bl_options = {"UNDO"}  # else the next Undo forgets the job

    @classmethod
    def poll(cls, context: Context) -> bool:
        cls.poll_message_set(_busy() or "Import a capture first")
        return not _busy() and active_capture(context) is not None

    @reporting()
    def execute(self, context: Context) -> set[str] | None:
        settings, collection = context.scene.nmf, active_capture(context)
        python = preferences.solver_python()
        job = create_job(
            collection, new_job_root(collection.name), preset=settings.preset,
            device=settings.device, seed=settings.seed,
            time_limit=60 * settings.time_limit if settings.use_time_limit else None,
            overrides=chosen_overrides(settings),
        )  # fmt: skip
        monitor.start(python, job)
        problem = region_problem(collection, to_capture_space(collection))
        alone = bpy.app.background and ALONE
        for text in filter(None, (problem, shown_twice(collection), alone)):
            self.report({"WARNING"}, text)
        settings.job = stored_path(job.root)
        if collection != context.scene.collection:
            settings.capture = collection
        remember_job(collection, job.root.name)


class NMF_OT_resume(Operator):
    """Continue the last job from where it stopped"""

    bl_idname = "nmf.resume"
    bl_label = "Resume"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context: Context) -> bool:
        cls.poll_message_set(_busy() or "There is no job to resume")
        return not _busy() and monitor.job is not None

    @reporting()
    def execute(self, context: Context) -> set[str] | None:
        job = monitor.job
        if model_of_folder(job).state == "elsewhere":  # begun since the panel has looked
            monitor.look_at(str(job.root))
            raise JobError(f"{job.root}: another process is working on this job; cancel it first.")
        python = preferences.solver_python()
        monitor.start(python, JobFolder.open(job.root))
        context.scene.nmf.job = stored_path(monitor.job.root)


class NMF_OT_cancel(Operator):
    """Stop the job; what is done so far is kept, and Resume continues from there"""

    bl_idname = "nmf.cancel"
    bl_label = "Cancel"

    @classmethod
    def poll(cls, context: Context) -> bool:
        cls.poll_message_set("No job is running")
        return monitor.running and not monitor.model.cancelling

    def execute(self, context: Context) -> set[str]:
        monitor.cancel()
        return {"FINISHED"}


classes = (NMF_OT_reconstruct, NMF_OT_resume, NMF_OT_cancel)
