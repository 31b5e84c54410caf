"""The region box: add one, fit it to what masks show."""

from __future__ import annotations

import bpy

from ..nmf_addon.scene.capture_collection import (
    active_capture,
    add_region_box,
    capture_named,
    fit_region_box,
)
from ..solver.capture.errors import CaptureError


class NMF_OT_add_region_box(bpy.types.Operator):
    """Add a box that says where the object is; move and scale it"""

    bl_idname = "nmf.add_region_box"
    bl_label = "Add Region Box"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """With a capture."""
        cls.poll_message_set("Import a capture first")
        return active_capture(context) is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Add the box."""
        try:
            add_region_box(context, active_capture(context))
        except CaptureError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class NMF_OT_fit_region_box(bpy.types.Operator):
    """Fit the region box to where all photos' masks show the object"""

    bl_idname = "nmf.fit_region_box"
    bl_label = "Fit Box to Masks"
    bl_options = {"REGISTER", "UNDO"}

    collection: bpy.props.StringProperty(options={"HIDDEN", "SKIP_SAVE"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """With a capture."""
        cls.poll_message_set("Import a capture first")
        return active_capture(context) is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Move the box."""
        collection = capture_named(context.scene, self.collection) or active_capture(context)
        if fit_region_box(collection) is None:
            self.report({"ERROR"}, "Press Check Capture first, with photos that have masks.")
            return {"CANCELLED"}
        return {"FINISHED"}


classes = (NMF_OT_add_region_box, NMF_OT_fit_region_box)
