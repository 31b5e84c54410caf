"""The sidebar tab "NMF" of the 3D View."""

from __future__ import annotations

import bpy

from . import preferences, thumbnails
from .jobs.monitor import monitor
from .runtime import RuntimeMissing, solver_python
from .scene.cameras import photo_of
from .scene.capture_collection import active_capture, region_box


class Sidebar:
    """Where the panels stand."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "NMF"


class NMF_PT_capture(Sidebar, bpy.types.Panel):
    """Cameras, photos and the region of interest."""

    bl_label = "Capture"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the panel."""
        layout = self.layout
        layout.operator("nmf.import_capture", icon="IMPORT")
        collection = active_capture(context)
        if collection is None:
            column = layout.column()
            column.active = False
            column.label(text="Photos with known cameras:")
            column.label(text="a transforms.json of any tool.")
            return
        layout.prop(context.scene.nmf, "capture", text="", placeholder=collection.name)
        cameras = sum(
            i.type == "CAMERA" and photo_of(i) is not None for i in collection.all_objects
        )
        layout.label(text=f"{cameras} cameras with photos", icon="CAMERA_DATA")
        if region_box(collection) is None:
            layout.operator("nmf.add_region_box", icon="CUBE")
        else:
            layout.label(text="Region: move and scale the box", icon="CUBE")


class NMF_PT_reconstruct(Sidebar, bpy.types.Panel):
    """Start, watch and cancel a reconstruction."""

    bl_label = "Reconstruct"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the panel."""
        layout = self.layout
        settings = context.scene.nmf
        if not _solver_ready(layout):
            return
        column = layout.column()
        column.use_property_split, column.use_property_decorate = True, False
        column.enabled = not monitor.running
        column.prop(settings, "preset")
        column.prop(settings, "device")
        row = column.row(heading="Time Limit")
        row.prop(settings, "use_time_limit", text="")
        limited = row.row()
        limited.enabled = settings.use_time_limit
        limited.prop(settings, "time_limit", text="Minutes")
        if monitor.running:
            _draw_progress(layout)
        else:
            row = layout.row()
            row.scale_y = 1.6
            row.operator("nmf.reconstruct", icon="SHADERFX")
            _draw_outcome(layout)
        icon = thumbnails.preview_icon(monitor)
        if icon:
            layout.template_icon(icon_value=icon, scale=8.0)
            row = layout.row()
            row.active = False
            row.label(text="Photo · render · normals")


class NMF_PT_result(Sidebar, bpy.types.Panel):
    """Install, relight and compare a result."""

    bl_label = "Result"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the panel."""
        layout = self.layout
        layout.operator("nmf.install_result", icon="PACKAGE")
        layout.operator("nmf.relight_hdri", icon="LIGHT_SUN")
        layout.operator("nmf.match_solver", icon="RENDER_STILL")
        layout.operator("nmf.open_job_folder", icon="FILE_FOLDER")


def _solver_ready(layout: bpy.types.UILayout) -> bool:
    try:
        solver_python(preferences.chosen_python())
    except RuntimeMissing:
        box = layout.box()
        box.label(text="The solver is not set up yet", icon="INFO")
        box.label(text="Once per computer, about 2 GB")
        box.operator("nmf.setup_solver", icon="IMPORT")
        return False
    return True


def _draw_progress(layout: bpy.types.UILayout) -> None:
    model = monitor.model
    layout.label(text=model.text)
    note = f"{100 * model.overall:.0f} %"
    if model.time_left:
        note += f"   {model.time_left}"
    if model.psnr is not None and model.stage == "fit":
        note += f"   {model.psnr:.1f} dB"
    layout.progress(factor=model.overall, text=note, type="BAR")
    layout.operator("nmf.cancel", icon="X")


def _draw_outcome(layout: bpy.types.UILayout) -> None:
    model = monitor.model
    icons = {"done": "CHECKMARK", "cancelled": "CANCEL", "failed": "ERROR"}
    if model.state not in icons:
        return
    layout.label(text=model.text, icon=icons[model.state])
    for line in model.error.splitlines()[-4:]:
        layout.label(text=line)
    if model.state != "done":
        if monitor.job is not None and monitor.job.has_checkpoint():
            layout.operator("nmf.resume", icon="PLAY")
        layout.operator("nmf.copy_report", icon="COPYDOWN")


classes = (NMF_PT_capture, NMF_PT_reconstruct, NMF_PT_result)
