"""The sidebar tab "NMF" of the 3D View: capture, reconstruct, result."""

from bpy.types import Context, Panel, UILayout

from ..solver.capture.errors import counted
from ..solver.job.events import clock
from . import preferences, runtime, thumbnails
from .jobs.model import JobModel
from .jobs.monitor import monitor
from .jobs.side_task import side_task
from .names import BASE_PACKAGE
from .scene.awaited_copies import awaiting
from .scene.capture_collection import active_capture, photo_cameras
from .scene.findings import check_report, masked_box
from .scene.hidden_photos import hidden_cameras
from .scene.region import region_box
from .scene.shot import shot_camera
from .wrapping import fields, note, paragraph, units

NARROW = 12.0  # button heights of panels in which two buttons beside each other are cut off
ERROR_LINES = 3
MOST_FINDINGS = 6
OUTCOME_ICONS = {"done": "CHECKMARK", "cancelled": "PAUSE", "failed": "ERROR", "lost": "ERROR",
                 "elsewhere": "INFO"}  # fmt: skip


class Sidebar:
    """Where the panels stand."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "NMF"
    icon = ""

    def draw_header(self, context: Context) -> None:
        self.layout.label(icon=self.icon)


class NMF_PT_capture(Sidebar, Panel):
    """Cameras, photos and the region of interest"""

    bl_label = "Capture"
    icon = "CAMERA_DATA"

    def draw(self, context: Context) -> None:
        layout = self.layout
        collection = active_capture(context)
        if collection is None:
            row = layout.row()
            row.scale_y = 1.4
            row.operator("nmf.import_capture", icon="IMPORT")
            _draw_solve(layout, context, {})
            note(layout, context, "Import photos with cameras from COLMAP, Metashape, RealityScan, "
                  "Meshroom, transforms.json and others, or drop a camera file here. For photos "
                  "alone, or a video: Solve Cameras.")  # fmt: skip
            _draw_task(layout, context)
            return
        narrow = units(context) < NARROW
        column = layout.column(align=True)
        row = column.row(align=True)
        row.prop(context.scene.nmf, "capture", text="", placeholder=collection.name)
        row = column.row(align=True) if narrow else row
        row.operator("nmf.import_capture", text="", icon="IMPORT")
        _draw_solve(row, context, {"text": ""})
        row = layout.row(align=True)
        text = f"{len(photo_cameras(collection))} photo|photos with camera|cameras"
        row.label(text=counted(text), icon="IMAGE_DATA")
        if hidden_cameras(collection) and not side_task.running:
            row.operator("nmf.show_photos", icon="HIDE_ON")
        if left := awaiting(collection.all_objects):
            text = f"{len(left)} photo|photos left to undistort"
            layout.label(text=counted(text), icon="SORTTIME")
        report = check_report(collection)
        if region_box(collection) is None:
            layout.operator("nmf.add_region_box", icon="CUBE")
        else:
            row = layout.row(align=True)
            row.operator("nmf.select_region_box", icon="CUBE")
            if masked_box(report) is not None:
                row.operator("nmf.fit_region_box", text="", icon="MOD_MASK")
        pair = layout.column(align=True) if narrow else layout.row(align=True)
        pair.operator("nmf.set_scale", icon="DRIVER_DISTANCE")
        if side_task.running:  # see _draw_solve
            pair.label()
        else:
            pair.operator("nmf.check_capture", icon="VIEWZOOM")
        _draw_task(layout, context)
        _draw_findings(layout, context, report)


class NMF_PT_reconstruct(Sidebar, Panel):
    """Start, watch and cancel a reconstruction"""

    bl_label = "Reconstruct"
    icon = "SHADERFX"

    def draw(self, context: Context) -> None:
        layout = self.layout
        if monitor.running:
            _draw_progress(layout, context)
            _draw_preview(layout, context)
            return
        python, problem = runtime.solver_state(
            preferences.chosen("python"), preferences.chosen("runtime_folder")
        )
        if python is None:
            _draw_missing_solver(layout, context, problem)
            return
        _draw_settings(layout, context.scene.nmf)
        row = layout.row()
        row.scale_y = 1.6
        row.operator("nmf.reconstruct", icon="PLAY")
        _draw_outcome(layout, context)
        _draw_preview(layout, context)


class NMF_PT_result(Sidebar, Panel):
    """Install, relight and compare a result"""

    bl_label = "Result"
    icon = "MATERIAL"

    def draw(self, context: Context) -> None:
        layout = self.layout
        column = layout.column(align=True)
        column.operator("nmf.relight_hdri", icon="WORLD")
        column.operator("nmf.match_solver", icon="RENDER_STILL")
        column = layout.column(align=True)
        column.operator("nmf.install_result", icon="APPEND_BLEND")
        column.operator("nmf.open_report", icon="URL")
        column.operator("nmf.open_job_folder", icon="FILE_FOLDER")


def _draw_solve(layout: UILayout, context: Context, words: dict[str, str]) -> None:
    """Solve Cameras, and Use Moving Camera where there is one.

    None while a task runs: Blender leaves a button that goes grey under the pointer grey after that.
    """
    if side_task.running:
        return
    layout.operator("nmf.solve_cameras", icon="CON_CAMERASOLVER", **words)
    if shot_camera(context) is not None:
        layout.operator("nmf.use_moving_camera", icon="VIEW_CAMERA", **words)


def _draw_task(layout: UILayout, context: Context) -> None:
    model = side_task.model
    if side_task.running:
        _draw_bar(layout, context, model, "nmf.cancel_task")
    elif model.state in OUTCOME_ICONS and not _is_undone(context):
        _draw_end(layout, context, model)


def _is_undone(context: Context) -> bool:
    """Whether what the last task has done is not to be seen in the tab's capture."""
    holds_for, collection = side_task.holds_for, active_capture(context)
    is_told = side_task.model.state != "done" or holds_for is None
    return not is_told and (collection is None or not holds_for(collection))


def _draw_bar(layout: UILayout, context: Context, model: JobModel, cancel: str) -> None:
    doing = "Cancelling…" if model.cancelling else model.text
    paragraph(layout, context, doing, icon="SORTTIME")
    column = layout.column(align=True)
    parts = [f"{100 * model.overall:.0f} %", model.time_left]
    column.progress(factor=model.overall, text="   ".join(filter(None, parts)), type="BAR")
    column.operator(cancel, icon="X")


def _draw_findings(layout: UILayout, context: Context, report: dict) -> None:
    if not report:
        return
    findings = report.get("findings", [])
    box = layout.box()
    for finding in findings[:MOST_FINDINGS]:
        about = f"{finding['photo']}: " if finding.get("photo") else ""
        icon = "ERROR" if finding.get("level") == "warning" else "INFO"
        paragraph(box, context, about + finding.get("text", ""), icon=icon)
    if len(findings) > MOST_FINDINGS:
        note(box, context, f"and {len(findings) - MOST_FINDINGS} more")
    if report.get("estimate", {}).get("text"):
        paragraph(box, context, report["estimate"]["text"], icon="TIME")


def _draw_missing_solver(layout: UILayout, context: Context, problem: str) -> None:
    box = layout.box()
    paragraph(box, context, problem, icon="INFO")
    if preferences.chosen("python"):
        # What is set up here would not be used.
        shown = box.operator("preferences.addon_show", text="Open Preferences", icon="PREFERENCES")
        shown.module = BASE_PACKAGE
        return
    if runtime.variable_python():
        return
    note(box, context, f"Downloads {preferences.SIZE_TEXT} into a private folder, once per "
          "computer. Blender itself is not changed.")  # fmt: skip
    preferences.draw_setup(box, context)


def _draw_settings(layout: UILayout, settings) -> None:
    names = "preset", "device", "exposure", "turntable", "texture_size"
    column = fields(layout, settings, *names)
    row = column.row(heading="Time Limit")
    row.prop(settings, "use_time_limit", text="")
    limited = row.row()
    limited.enabled = settings.use_time_limit
    limited.prop(settings, "time_limit", text="min")


def _draw_progress(layout: UILayout, context: Context) -> None:
    model = monitor.model
    _draw_bar(layout, context, model, "nmf.cancel")
    if model.psnr is not None and model.stage == "fit":
        note(layout, context, f"Agreement with the photos: {model.psnr:.1f} dB")
    if monitor.silent_for:
        quiet = clock(monitor.silent_for)
        note(layout, context, f"No news for {quiet}; the solver is still running.")
    _draw_warnings(layout, context, model)


def _draw_outcome(layout: UILayout, context: Context) -> None:
    model = monitor.model
    if model.state not in OUTCOME_ICONS:
        return
    box = layout.box()
    _draw_end(box, context, model)
    if model.state in ("cancelled", "failed", "lost"):
        row = box.row(align=True)
        if model.resumable:
            row.operator("nmf.resume", icon="PLAY")
        if model.state != "cancelled":
            row.operator("nmf.copy_report", icon="COPYDOWN")


def _draw_end(layout: UILayout, context: Context, model: JobModel) -> None:
    paragraph(layout, context, model.text, icon=OUTCOME_ICONS[model.state])
    for line in short_error(model.error):
        note(layout, context, line)
    _draw_warnings(layout, context, model)


def short_error(text: str) -> list[str]:
    """The first line of an error and the last ones of its log, without a traceback's code."""
    lines = [line for line in text.splitlines() if line.strip()]
    told = lines[:1] + [line for line in lines[1:] if not line[0].isspace()]
    return told if len(told) <= ERROR_LINES else told[:1] + told[1 - ERROR_LINES :]


def _draw_warnings(layout: UILayout, context: Context, model: JobModel) -> None:
    for text in model.warnings[:2]:
        paragraph(layout, context, text, icon="ERROR")
    if len(model.warnings) > 2:
        note(layout, context, f"and {len(model.warnings) - 2} more in the log")


def _draw_preview(layout: UILayout, context: Context) -> None:
    pictures = thumbnails.icons()
    if not pictures:
        return
    scale = max((units(context) - 1.5) / len(pictures), 2.0)
    row = layout.row(align=True)
    for name, icon in pictures:
        column = row.column(align=True)
        column.template_icon(icon_value=icon, scale=scale)
        caption = column.row()
        caption.active, caption.alignment = False, "CENTER"
        caption.label(text=name)


classes = (NMF_PT_capture, NMF_PT_reconstruct, NMF_PT_result)
