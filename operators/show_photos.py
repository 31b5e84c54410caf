"""Show photos that Blender cannot decode."""

import tempfile
from pathlib import Path

import bpy

from ..nmf_addon import preferences
from ..nmf_addon.jobs.create import create_job
from ..nmf_addon.jobs.side_task import SideTask, side_task
from ..nmf_addon.scene.capture_collection import active_capture, capture_of_number
from ..nmf_addon.scene.hidden_photos import hidden_cameras, show_pictures
from .polls import is_busy, reporting


class NMF_OT_show_photos(bpy.types.Operator):
    """Put copies of HEIC, AVIF and raw photos, which Blender cannot show, behind their cameras"""

    bl_idname = "nmf.show_photos"
    bl_label = "Show Photos"

    said: bpy.props.StringProperty(
        description="What the task before it had to say", options={"HIDDEN", "SKIP_SAVE"}
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """With a capture that has such photos, while no other task runs."""
        if is_busy(cls):
            return False
        cls.poll_message_set("The capture has no photos that Blender cannot show")
        collection = active_capture(context)
        return collection is not None and bool(hidden_cameras(collection))

    @reporting()
    def execute(self, context: bpy.types.Context) -> set[str] | None:
        collection = active_capture(context)
        folder = Path(tempfile.mkdtemp(prefix="nmf-pictures-", dir=bpy.app.tempdir))
        number, said = collection.session_uid, self.said

        def done(task: SideTask) -> None:
            found = capture_of_number(number)
            result = next(event.data for event in task.events if event.kind == "result")
            count = 0 if found is None else show_pictures(found, result["pictures"])
            task.model.text = said or f"Photos shown: {count}"
            left = 0 if found is None else len(hidden_cameras(found))
            task.holds_for = lambda c: (
                c.session_uid == number and bool(said or len(hidden_cameras(c)) <= left)
            )
            bpy.ops.ed.undo_push(message=NMF_OT_show_photos.bl_label)

        python = preferences.solver_python()
        job = create_job(collection, folder / "job")
        words = ["pictures", str(job.root), "--out", str(folder / "pictures"), "--events"]
        side_task.start(self.bl_label, python, words, folder, done)


classes = (NMF_OT_show_photos,)
