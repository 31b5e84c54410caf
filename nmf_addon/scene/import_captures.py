"""Importing captures: cameras from a file, shown with their photos in a collection of the scene."""

from pathlib import Path

import bpy
import numpy as np
from bpy.types import Collection, Context, Image, Object

from ...solver.capture.camera import Camera
from ...solver.capture.capture import Capture
from ...solver.capture.errors import CaptureError
from ...solver.capture.image_header import blender_shows
from ...solver.capture.placement import placed, suggest_placement
from ...solver.capture.read import read_capture
from .awaited_copies import await_copies
from .background import is_distorted, turn_of
from .cameras import add_camera, frame_of
from .capture_collection import FILE_TO_CAPTURE, ROOT, SOURCE, WARNINGS
from .images import load_image, nothing_left_behind
from .region import new_region_box

MOST_POINTS = 200_000


def import_capture(
    context: Context, path: Path, photos: Path | None = None, masks: Path | None = None,
    ignored: Path | None = None,
) -> Collection:  # fmt: skip
    """Read a capture and show it; see `import_captures`."""
    return import_captures(context, [path], photos, masks, ignored=ignored)[0]


def import_captures(
    context: Context, paths: list[Path], photos: Path | None = None,
    masks: Path | None = None, as_they_stand: bool = False, ignored: Path | None = None,
) -> list[Collection]:  # fmt: skip
    """Read cameras and show them with their photos, upright, in a box for the object.

    All is read before anything is added: nothing changes if reading fails half way. Several files
    of one model (COLMAP's) are one capture.

    Args:
        photos, masks, ignored: as in `read_capture`.
        as_they_stand: the file's coordinates are the scene's; nothing is set upright or scaled.

    Raises:
        CaptureError: with file, field and remedy; the scene is in another file.
    """
    if context.scene.library is not None:
        raise CaptureError(paths[0], "", "the scene is in another file", "import into a scene of this one")
    captures = {}
    for path in paths:
        capture = read_capture(path, photos=photos, masks=masks, ignored=ignored)
        captures[capture.source] = capture
    images = _load_photos([camera for c in captures.values() for camera in c.cameras])
    return [
        _add_capture(context, capture, images, np.eye(4) if as_they_stand else suggest_placement(capture))
        for capture in captures.values()
    ]


def _add_capture(
    context: Context, capture: Capture, images: dict[Path, Image], matrix: np.ndarray
) -> Collection:
    capture = placed(capture, matrix)
    collection = bpy.data.collections.new(f"Capture {capture.source.parent.name}")
    collection[SOURCE], collection[WARNINGS] = str(capture.source), list(capture.warnings)
    context.scene.collection.children.link(collection)
    root = bpy.data.objects.new(f"{collection.name} Transform", None)
    root[ROOT] = True
    root[FILE_TO_CAPTURE] = matrix.ravel().tolist()
    root.empty_display_type = "ARROWS"
    collection.objects.link(root)
    # What is many: the outliner folds that away, and no dashed lines lead to what is not shown.
    above_cameras = bpy.data.objects.new(f"{collection.name} Cameras", None)
    above_cameras.parent, above_cameras.hide_viewport = root, True
    collection.objects.link(above_cameras)
    frame, awaited = frame_of(context.scene), []
    for camera in capture.cameras:
        differs = (
            not camera.is_panoramic
            and blender_shows(camera.image_path)
            and (is_distorted(camera) or turn_of(camera) != 1)
        )
        item = add_camera(camera, images[camera.image_path], frame)
        item.parent = above_cameras
        collection.objects.link(item)
        awaited += [item] if differs else []
    await_copies(awaited)
    if capture.points is not None:
        _add_points(collection, capture.points, root)
    new_region_box(collection, capture.region, root)
    first = next(item for item in collection.objects if item.type == "CAMERA")
    if context.scene.camera is None:
        context.scene.camera = first
    return collection


def _load_photos(cameras: list[Camera]) -> dict[Path, Image]:
    """Images of the cameras' photos; those that were loaded go again if one cannot be."""
    images = {}
    with nothing_left_behind(bpy.data.images):
        for camera in cameras:
            try:
                image = load_image(camera.image_path, check_existing=True)
            except RuntimeError as error:
                raise CaptureError(
                    camera.image_path, "", "Blender cannot open the photo", "replace or convert it"
                ) from error
            images[camera.image_path] = image
    return images


def _add_points(collection: Collection, points: np.ndarray, root: Object) -> None:
    """Sparse points as a mesh of vertices, to see the object in while fitting the box."""
    points = points[:: max(-(-len(points) // MOST_POINTS), 1)]
    mesh = bpy.data.meshes.new(f"{collection.name} Points")
    mesh.vertices.add(len(points))
    mesh.vertices.foreach_set("co", np.ascontiguousarray(points, dtype=np.float32).ravel())
    mesh.update()
    item = bpy.data.objects.new(mesh.name, mesh)
    item.parent, item.hide_render, item.hide_select = root, True, True
    collection.objects.link(item)
