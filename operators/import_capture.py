"""Import cameras with their photos."""

from contextlib import suppress
from pathlib import Path

import bpy
from bpy.types import Context, Event, FileHandler, Operator, OperatorFileListElement
from bpy_extras.io_utils import ImportHelper

from ..nmf_addon.scene.archives import unpack_all
from ..nmf_addon.scene.capture_collection import warnings_of
from ..nmf_addon.scene.import_captures import import_captures
from ..nmf_addon.wrapping import fields
from ..solver.capture.archives import ARCHIVES
from ..solver.capture.read import CAMERA_FILES
from .polls import reporting

FILTER = ";".join(f"*{extension}" for extension in CAMERA_FILES + ARCHIVES)
INSTALLED = ".zip"
"""what is dropped of it Blender takes for an extension, before it asks anybody else"""

IGNORED = (
    "Folder of pictures, named like the photos, that are white where something is to be ignored, such as a "
    "hand or a tripod; or one picture for all photos"
)


def _stated(name: str, description: str):
    return bpy.props.StringProperty(name=name, description=description, options={"SKIP_SAVE"})


class NMF_OT_import_capture(ImportHelper, Operator):
    """Import photos with known cameras as a capture: pick a camera file, its folder, or an app's
    archive (.zip, .r3d), which is unpacked next to itself"""

    bl_idname = "nmf.import_capture"
    bl_label = "Import Capture"
    bl_options = {"REGISTER", "UNDO", "PRESET"}

    filter_glob: bpy.props.StringProperty(default=FILTER, options={"HIDDEN"})
    files: bpy.props.CollectionProperty(type=OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})
    directory: bpy.props.StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})
    photos: _stated("Photos", "Folder of the photos, if they are not in the cameras' folder")
    masks: _stated("Masks", "Folder of the masks, if it is not 'masks' next to the photos")
    ignored: _stated("Ignore", IGNORED)

    @reporting()
    def execute(self, context: Context) -> set[str] | None:
        """Import all that was picked, or nothing."""
        paths = self._paths()
        if not paths:  # of a script; the file browser has a folder at least
            self.report({"ERROR"}, "There is no path; give a camera file or a folder as filepath.")
            return {"CANCELLED"}
        paths = unpack_all(context, paths)
        others = [_folder(text) for text in (self.photos, self.masks, self.ignored)]
        photos, masks, ignored = unpack_all(context, others)
        made = import_captures(context, paths, photos, masks, ignored=ignored)
        context.scene.nmf.capture = made[-1]
        for collection in made:
            for text in warnings_of(collection):
                self.report({"WARNING"}, text)
        # Whoever calls this from a script, or has just solved cameras, decides for themselves.
        if self.options.is_invoke and bpy.ops.nmf.show_photos.poll():
            with suppress(RuntimeError):  # it reports why it cannot, and its button stays
                bpy.ops.nmf.show_photos()

    def invoke(self, context: Context, event: Event) -> set[str]:
        """Import what was dropped, else ask for a file."""
        if self.directory and any(entry.name for entry in self.files):
            return self.execute(context)
        return ImportHelper.invoke(self, context, event)

    def draw(self, context: Context) -> None:
        column = fields(self.layout, self, "photos", "masks", "ignored")
        column.label(text="Or pick a folder, or drop one here", icon="INFO")

    def _paths(self) -> list[Path]:
        folder = Path(bpy.path.abspath(self.directory)) if self.directory else None
        names = [entry.name for entry in self.files if entry.name]
        if folder is not None and names:
            return [folder / name for name in names]
        if self.filepath:
            return [Path(bpy.path.abspath(self.filepath))]
        return [] if folder is None else [folder]


def _folder(text: str) -> Path | None:
    return Path(bpy.path.abspath(text)) if text.strip() else None


class NMF_FH_capture(FileHandler):
    """Drop of camera files and archives into the 3D View."""

    bl_idname = "NMF_FH_capture"
    bl_label = "Capture for Microfacet Fields"
    bl_import_operator = "nmf.import_capture"
    bl_file_extensions = ";".join(e for e in CAMERA_FILES + ARCHIVES if e != INSTALLED)

    @classmethod
    def poll_drop(cls, context: Context) -> bool:
        return context.area is not None and context.area.type == "VIEW_3D"


def draw_menu(self, context: Context) -> None:
    """Entry of File › Import."""
    self.layout.operator(
        NMF_OT_import_capture.bl_idname, text="Capture for Microfacet Fields (Photos with Cameras)"
    )


classes = (NMF_OT_import_capture, NMF_FH_capture)
