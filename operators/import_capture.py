"""Import cameras with their photos."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy_extras.io_utils import ImportHelper

from ..nmf_addon.scene.capture_collection import import_capture, warnings_of
from ..solver.capture.errors import CaptureError


class NMF_OT_import_capture(ImportHelper, bpy.types.Operator):
    """Import photos with known cameras as a capture"""

    bl_idname = "nmf.import_capture"
    bl_label = "Import Capture"
    bl_options = {"REGISTER", "UNDO"}

    filter_glob: bpy.props.StringProperty(default="*.json", options={"HIDDEN"})
    filename_ext = ".json"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Import."""
        path = Path(bpy.path.abspath(self.filepath))
        try:
            collection = import_capture(context, path)
        except CaptureError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        context.scene.nmf.capture = collection
        for text in warnings_of(path):
            self.report({"WARNING"}, text)
        return {"FINISHED"}


class NMF_FH_transforms(bpy.types.FileHandler):
    """Drop of a camera file into the 3D View."""

    bl_idname = "NMF_FH_transforms"
    bl_label = "Capture for a microfacet field"
    bl_import_operator = "nmf.import_capture"
    bl_file_extensions = ".json"

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        """In the 3D View."""
        return context.area is not None and context.area.type == "VIEW_3D"


def draw_menu(self, context: bpy.types.Context) -> None:
    """Entry of File › Import."""
    self.layout.operator(
        NMF_OT_import_capture.bl_idname, text="Capture for Microfacet Field (.json)"
    )


classes = (NMF_OT_import_capture, NMF_FH_transforms)
