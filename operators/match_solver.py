"""Render settings of the solver."""

import bpy

from ..nmf_addon.scene.match_solver import match_photo, match_solver
from .polls import reporting


class NMF_OT_match_solver(bpy.types.Operator):
    """Set Cycles, the view transform and the size of the photos, so that renders compare with them"""

    bl_idname = "nmf.match_solver"
    bl_label = "Match Solver"
    bl_options = {"REGISTER", "UNDO"}

    bounces: bpy.props.IntProperty(
        name="Bounces", description="Reflections between surfaces that the solver traces", default=2, min=1
    )

    @reporting(RuntimeError)
    def execute(self, context: bpy.types.Context) -> set[str] | None:
        left = match_solver(context.scene, self.bounces)
        match_photo(context.scene)
        if left:
            self.report({"WARNING"}, left)


classes = (NMF_OT_match_solver,)
