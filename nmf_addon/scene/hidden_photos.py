"""Photos that Blender cannot show (HEIC, AVIF, raw): small copies stand behind the scene in their place."""

from pathlib import Path

import bpy

from ...solver.capture.image_header import blender_shows
from .background import empty_copy, fill_copy
from .cameras import copy_behind, keep_behind, photo_of, photo_path, show_behind, to_solver
from .capture_collection import to_capture_space
from .images import load_picture
from .panoramic_camera import PANORAMIC_TYPE


def hidden_cameras(collection: bpy.types.Collection) -> list[bpy.types.Object]:
    """Cameras with nothing to see behind the scene, for Blender cannot decode their photo."""
    return [item for item in collection.all_objects if item.type == "CAMERA" and _is_hidden(item)]


def show_pictures(collection: bpy.types.Collection, pictures: dict[str, str]) -> int:
    """Put copies of photos behind the cameras, without their lenses' distortion; returns how many.

    Args:
        pictures: the copies' files by those of the photos; as their cameras saw them.

    Raises:
        RuntimeError: Blender cannot read one.
    """
    matrix, shown = to_capture_space(collection), 0
    for item in hidden_cameras(collection):
        file = pictures.get(str(photo_path(photo_of(item))))
        if file is None:
            continue
        picture = load_picture(Path(file))
        try:
            copy = empty_copy(item.name)
            # The solver has turned the picture already.
            fill_copy(copy, to_solver(item, matrix), picture, turn=1)
            keep_behind(item.data, copy)
            show_behind(item.data, copy)
        finally:
            bpy.data.images.remove(picture)
        shown += 1
    return shown


def _is_hidden(item: bpy.types.Object) -> bool:
    photo = photo_of(item)
    if item.data.type == PANORAMIC_TYPE:
        return False  # no photo is shown behind one
    if photo is None or blender_shows(Path(photo.filepath)):
        return False
    return copy_behind(item.data) is None
