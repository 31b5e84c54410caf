"""Set a capture's scale from two points of a known distance."""

import bpy

from ..nmf_addon.scene.measure import LEAST, MeasureError, picked_capture, picked_points, scale_to
from .polls import WithCapture, reporting


class NMF_OT_set_scale(WithCapture, bpy.types.Operator):
    """Set the real distance between two selected vertices in Edit Mode, or two objects"""

    bl_idname = "nmf.set_scale"
    bl_label = "Set Scale"
    bl_options = {"REGISTER", "UNDO"}

    distance: bpy.props.FloatProperty(
        name="Distance", description="Distance between the two points in the real world",
        default=1.0, min=LEAST, subtype="DISTANCE", unit="LENGTH",
    )  # fmt: skip

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for the distance; what it measures now is the default."""
        try:
            first, second = picked_points(context)
        except MeasureError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.distance = (first - second).length
        return context.window_manager.invoke_props_dialog(self)

    @reporting()
    def execute(self, context: bpy.types.Context) -> set[str] | None:
        collection = picked_capture(context)
        factor = scale_to(collection, picked_points(context), self.distance)
        if context.mode == "EDIT_MESH":
            # Undo steps of Edit Mode know the mesh alone.
            bpy.ops.object.mode_set(mode="OBJECT")
        self.report({"INFO"}, f"{collection.name} was scaled by {factor:.4g}")


classes = (NMF_OT_set_scale,)
