"""Look at a capture before the long run."""

import tempfile
from pathlib import Path

import bpy

from ..nmf_addon import preferences
from ..nmf_addon.jobs.create import create_job
from ..nmf_addon.jobs.side_task import SideTask, side_task
from ..nmf_addon.properties import chosen_overrides
from ..nmf_addon.scene.capture_collection import active_capture, capture_of_number
from ..nmf_addon.scene.findings import check_report, keep_report
from ..nmf_addon.scene.region import is_as_placed, region_box
from .polls import WithCapture, is_busy, reporting


class NMF_OT_check_capture(WithCapture, bpy.types.Operator):
    """Look for blurred, badly exposed and missing views, and estimate time and memory; takes seconds"""

    bl_idname = "nmf.check_capture"
    bl_label = "Check Capture"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return not is_busy(cls) and super().poll(context)

    @reporting()
    def execute(self, context: bpy.types.Context) -> set[str] | None:
        collection, settings = active_capture(context), context.scene.nmf
        folder = Path(tempfile.mkdtemp(prefix="nmf-check-", dir=bpy.app.tempdir))
        number = collection.session_uid

        def done(task: SideTask) -> None:
            (report,) = (event.data["report"] for event in task.events if event.kind == "result")
            found = capture_of_number(number)
            if found is not None:
                keep_report(found, report)
            if found is not None and not found.library:
                box = region_box(found)
                can_fit = bpy.ops.nmf.fit_region_box.poll()  # not in a scene without captures
                if report.get("box") and box is not None and is_as_placed(box) and can_fit:
                    # True: an operator called from Python makes no undo step of its own accord.
                    bpy.ops.nmf.fit_region_box("EXEC_DEFAULT", True, collection=number)
                else:
                    bpy.ops.ed.undo_push(message=NMF_OT_check_capture.bl_label)
            count = sum(finding["level"] == "warning" for finding in report["findings"])
            plural = "" if count == 1 else "s"
            task.model.text = f"Check: {count or 'no'} warning{plural}"
            task.holds_for = lambda c: c.session_uid == number and check_report(c) == report

        python = preferences.solver_python()
        job = create_job(
            collection, folder / "job", preset=settings.preset, device=settings.device,
            overrides=chosen_overrides(settings),
        )  # fmt: skip
        words = ["check", str(job.root), "--preset", settings.preset, "--events"]
        side_task.start("Check Capture", python, words, folder, done)


classes = (NMF_OT_check_capture,)
