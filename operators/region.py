"""The region box: add one, select it, fit it to what masks show."""

import bpy
from bpy.types import Context, Operator

from ..nmf_addon.scene.capture_collection import active_capture, capture_of_number
from ..nmf_addon.scene.region import add_region_box, fit_region_box, region_box
from ..nmf_addon.scene.selection import make_active
from .polls import WithCapture, reporting


class NMF_OT_add_region_box(WithCapture, Operator):
    """Add a box to mark where the object is; move and scale it"""

    bl_idname = "nmf.add_region_box"
    bl_label = "Add Region Box"
    bl_options = {"REGISTER", "UNDO"}

    @reporting()
    def execute(self, context: Context) -> set[str] | None:
        box = add_region_box(context, active_capture(context))
        if context.mode == "OBJECT":
            make_active(box, context.view_layer)


class NMF_OT_select_region_box(Operator):
    """Select the region box; move and scale it until it holds the object and little else"""

    bl_idname = "nmf.select_region_box"
    bl_label = "Select Region Box"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Context) -> bool:
        collection = active_capture(context)
        there = collection is not None and region_box(collection) is not None
        cls.poll_message_set("Switch to Object Mode first" if there else "Add a region box first")
        return there and context.mode == "OBJECT"

    def execute(self, context: Context) -> set[str]:
        box = region_box(active_capture(context))
        if box.name in context.view_layer.objects:
            box.hide_set(False)
        if not make_active(box, context.view_layer):
            self.report({"ERROR"}, f"{box.name} is hidden; show it, or its collection.")
            return {"CANCELLED"}
        return {"FINISHED"}


class NMF_OT_fit_region_box(WithCapture, Operator):
    """Fit the region box to the object, as the masks of all photos show it"""

    bl_idname = "nmf.fit_region_box"
    bl_label = "Fit Box to Masks"
    bl_options = {"REGISTER", "UNDO"}

    collection: bpy.props.IntProperty(
        description="Its session_uid; 0 for the one in the tab", options={"HIDDEN", "SKIP_SAVE"}
    )

    @reporting()
    def execute(self, context: Context) -> set[str] | None:
        collection = capture_of_number(self.collection) or active_capture(context)
        box = fit_region_box(collection)
        if box is None:
            self.report({"ERROR"}, "Press Check Capture first, with photos that have masks.")
            return {"CANCELLED"}


classes = (NMF_OT_add_region_box, NMF_OT_select_region_box, NMF_OT_fit_region_box)
