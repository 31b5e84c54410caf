"""Relight the scene."""

from pathlib import Path

import bpy
from bpy_extras.io_utils import ImportHelper

from ..nmf_addon.scene.world import relight
from .polls import reporting


class NMF_OT_relight_hdri(ImportHelper, bpy.types.Operator):
    """Light the scene with another HDRI; the recovered light stays in the file as a World"""

    bl_idname = "nmf.relight_hdri"
    bl_label = "Relight with HDRI"
    bl_options = {"REGISTER", "UNDO"}

    filter_glob: bpy.props.StringProperty(default="*.exr;*.hdr", options={"HIDDEN"})

    @reporting(RuntimeError)
    def execute(self, context: bpy.types.Context) -> set[str] | None:
        relight(context.scene, Path(bpy.path.abspath(self.filepath)))


classes = (NMF_OT_relight_hdri,)
