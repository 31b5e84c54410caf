"""A capture in the scene: a collection of cameras under one empty, with a region box.

The empty carries the similarity transform (up, scale, origin) from capture space to the world; the
collection is the truth the solver is started from.
"""

import math
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ...solver.capture.camera import Camera
from ...solver.capture.capture import Capture, region_seen_by
from ...solver.capture.errors import CaptureError
from ...solver.capture.formats.transforms import write_transforms
from ...solver.capture.image_header import blender_shows
from ...solver.capture.placement import placed, suggest_placement
from ...solver.capture.read import read_capture
from .awaited_copies import await_copies
from .background import is_distorted, turn_of
from .cameras import add_camera, frame_of, photo_of, photo_path, to_solver
from .evaluated import settle
from .findings import check_report, masked_box
from .images import load_image, nothing_left_behind
from .region import new_region_box, place_box, region_box

SOURCE, ROOT, WARNINGS = "nmf_source", "nmf_root", "nmf_warnings"
FILE_TO_CAPTURE = "nmf_file_to_capture"
JOBS = "nmf_last_job"
"""names of the job folders that the capture was reconstructed in, a line each, the last one last"""
MOST_POINTS = 200_000


def import_capture(
    context: bpy.types.Context, path: Path, photos: Path | None = None, masks: Path | None = None,
    ignored: Path | None = None,
) -> bpy.types.Collection:  # fmt: skip
    """Read a capture and show it; see `import_captures`."""
    return import_captures(context, [path], photos, masks, ignored=ignored)[0]


def import_captures(
    context: bpy.types.Context, paths: list[Path], photos: Path | None = None,
    masks: Path | None = None, as_they_stand: bool = False, ignored: Path | None = None,
) -> list[bpy.types.Collection]:  # fmt: skip
    """Read cameras and show them with their photos, upright, in a box for the object.

    All is read before anything is added: nothing changes if reading fails half way. Several files
    of one model (COLMAP's) are one capture.

    Args:
        photos, masks: their folders, if they are not below the capture's.
        as_they_stand: the file's coordinates are the scene's; nothing is set upright or scaled.
        ignored: a folder of pictures that are white where photos are to be ignored, or one for all photos.

    Raises:
        CaptureError: with file, field and remedy.
    """
    captures = {}
    for path in paths:
        capture = read_capture(path, photos=photos, masks=masks, ignored=ignored)
        captures[capture.source] = capture
    images = _load_photos([camera for c in captures.values() for camera in c.cameras])
    return [
        _add_capture(
            context, capture, images, np.eye(4) if as_they_stand else suggest_placement(capture)
        )
        for capture in captures.values()
    ]


def _add_capture(
    context: bpy.types.Context, capture: Capture, images: dict[Path, bpy.types.Image],
    matrix: np.ndarray,
) -> bpy.types.Collection:  # fmt: skip
    capture = placed(capture, matrix)
    collection = bpy.data.collections.new(_capture_name(capture))
    collection[SOURCE], collection[WARNINGS] = str(capture.source), list(capture.warnings)
    context.scene.collection.children.link(collection)
    root = bpy.data.objects.new(f"{collection.name} Transform", None)
    root[ROOT] = True
    root[FILE_TO_CAPTURE] = matrix.ravel().tolist()
    root.empty_display_type = "ARROWS"
    collection.objects.link(root)
    above_cameras = _unseen_empty(f"{collection.name} Cameras", root)
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


def _unseen_empty(name: str, root: bpy.types.Object) -> bpy.types.Object:
    """An empty under a capture's own for what is many.

    The outliner folds them away below it, and viewports draw no dashed line from each of them to a
    parent that they do not show.
    """
    item = bpy.data.objects.new(name, None)
    item.parent, item.hide_viewport = root, True
    return item


def jobs_of(collection: bpy.types.Collection) -> list[str]:
    """Names of the job folders that a capture was reconstructed in, the last one last."""
    return str(collection.get(JOBS, "")).splitlines()


def remember_job(collection: bpy.types.Collection, name: str) -> None:
    """Let a capture know a job folder that it is reconstructed in."""
    if not collection.library:
        collection[JOBS] = "\n".join(
            [*(other for other in jobs_of(collection) if other != name), name]
        )


def warnings_of(collection: bpy.types.Collection) -> list[str]:
    """What reading the capture had to say."""
    return [str(text) for text in collection.get(WARNINGS, ())]


def _load_photos(cameras: list[Camera]) -> dict[Path, bpy.types.Image]:
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


def _add_points(
    collection: bpy.types.Collection, points: np.ndarray, root: bpy.types.Object
) -> bpy.types.Object:
    """Sparse points as a mesh of vertices, to see the object in while fitting the box."""
    points = points[:: max(-(-len(points) // MOST_POINTS), 1)]
    mesh = bpy.data.meshes.new(f"{collection.name} Points")
    mesh.vertices.add(len(points))
    mesh.vertices.foreach_set("co", np.ascontiguousarray(points, dtype=np.float32).ravel())
    mesh.update()
    item = bpy.data.objects.new(mesh.name, mesh)
    item.parent, item.hide_render, item.hide_select = root, True, True
    collection.objects.link(item)
    return item


def capture_collections(scene: bpy.types.Scene) -> list[bpy.types.Collection]:
    """Collections of the scene that hold at least one camera with a photo."""
    holding: set[bpy.types.Collection] = set()

    def look_into(collection: bpy.types.Collection) -> bool:
        # The panel asks in every draw: objects are looked at once, not for each collection around them.
        below = [look_into(child) for child in collection.children]
        if any(below) or any(map(_has_photo, collection.objects)):
            holding.add(collection)
        return collection in holding

    look_into(scene.collection)
    return [c for c in scene.collection.children_recursive if c in holding]


def is_capture(collection: bpy.types.Collection) -> bool:
    """True if it holds a camera with a photo."""
    return any(_has_photo(item) for item in collection.all_objects)


def active_capture(context: bpy.types.Context) -> bpy.types.Collection | None:
    """The capture chosen in the panel, else the active collection, else the first capture.

    The scene's own collection only counts where cameras lie in no other.
    """
    whole = context.scene.collection
    if not any(camera.background_images for camera in bpy.data.cameras):
        return None
    for collection in (context.scene.nmf.capture, context.collection):
        if collection in whole.children_recursive and is_capture(collection):
            return collection
    captures = capture_collections(context.scene)
    return captures[0] if captures else whole if is_capture(whole) else None


def capture_of_number(number: int) -> bpy.types.Collection | None:
    """The collection of a `session_uid`, which renaming and Undo leave as it is, and which may be a scene's
    own; None if it is gone."""
    all_there = (*bpy.data.collections, *(scene.collection for scene in bpy.data.scenes))
    return next((c for c in all_there if c.session_uid == number), None)


def scene_of(
    collection: bpy.types.Collection, first: bpy.types.Scene | None = None
) -> bpy.types.Scene | None:
    """The first scene that a collection is in: `first`, if it is in that, else by name."""
    there = [s for s in bpy.data.scenes if collection in s.collection.children_recursive]
    return first if first in there else next(iter(there), None)


def root_of(collection: bpy.types.Collection) -> bpy.types.Object | None:
    """The empty with the capture's similarity transform; None for foreign cameras."""
    return next((item for item in collection.all_objects if item.get(ROOT)), None)


def to_capture_space(collection: bpy.types.Collection) -> Matrix:
    """World to capture space.

    Raises:
        CaptureError: the capture's empty has a scale of 0.
    """
    root = root_of(collection)
    if root is None:
        return Matrix.Identity(4)
    try:
        return root.matrix_world.inverted()
    except ValueError as error:
        raise CaptureError(
            root.name, "scale", "it is 0", "give the capture's empty another scale"
        ) from error


def placement_of(collection: bpy.types.Collection) -> list[list[float]]:
    """Rows of the similarity [4][4] from capture space to the world; where a person has scaled the empty
    unevenly, with the mean of its scales."""
    root = root_of(collection)
    if root is None:
        return [list(row) for row in Matrix.Identity(4)]
    settle(collection)
    place, turn, scale = root.matrix_world.decompose()
    even = abs(math.prod(scale)) ** (1 / 3)
    return [list(row) for row in Matrix.LocRotScale(place, turn, Vector((even, even, even)))]


def write_capture(collection: bpy.types.Collection, folder: Path) -> Path:
    """Write the collection's cameras for the solver; returns the camera file.

    Raises:
        CaptureError: no cameras, or photos or masks missing.
    """
    settle(collection)
    items = photo_cameras(collection)
    if not items:
        raise CaptureError(
            collection.name, "cameras", "the collection holds no camera with a photo",
            "import a capture or add photos as background images",
        )  # fmt: skip
    matrix = to_capture_space(collection)
    path = folder / "transforms_train.json"
    cameras = [to_solver(item, matrix) for item in items]
    for camera in cameras:
        for mask in (camera.mask_path, camera.ignored_path):
            if mask is not None and not mask.is_file():
                raise CaptureError(
                    mask, f"mask of {camera.name}", "it does not exist",
                    "put the masks back, or import the capture again",
                )  # fmt: skip
    write_transforms(path, cameras)
    return path


def photo_paths(collection: bpy.types.Collection) -> set[Path]:
    """Where the photos of a collection's cameras lie."""
    return {photo_path(photo_of(item)).resolve() for item in photo_cameras(collection)}


def add_region_box(
    context: bpy.types.Context, collection: bpy.types.Collection
) -> bpy.types.Object:
    """A box empty around what the cameras look at, for the person to move and scale.

    Raises:
        CaptureError: a camera cannot be used, or the capture is in another file.
    """
    existing = region_box(collection)
    if existing is not None:
        return existing
    settle(collection)
    matrix = to_capture_space(collection)
    cameras = [to_solver(item, matrix) for item in photo_cameras(collection)]
    return new_region_box(collection, region_seen_by(cameras), root_of(collection))


def region_of(collection: bpy.types.Collection) -> dict[str, list[float]] | None:
    """The region box in capture space as {"min": …, "max": …}; None if there is none.

    Raises:
        CaptureError: the box is flat.
    """
    box = region_box(collection)
    if box is None:
        return None
    settle(collection)
    matrix = np.array(to_capture_space(collection) @ box.matrix_world)
    size = box.empty_display_size
    corners = np.array(np.meshgrid(*[(-size, size)] * 3)).reshape(3, -1)
    points = matrix[:3, :3] @ corners + matrix[:3, 3:]
    if (np.ptp(points, axis=1) <= 0).any():
        raise CaptureError(
            box.name, "scale", "the region box is flat", "scale it until the object fits into it"
        )
    return {"min": points.min(1).tolist(), "max": points.max(1).tolist()}


def fit_region_box(collection: bpy.types.Collection) -> bpy.types.Object | None:
    """Move the region box to where masks show the object, or make one there; None if none do.

    Raises:
        CaptureError: the capture is in another file, where a change would not last.
    """
    region, box = masked_box(check_report(collection)), region_box(collection)
    if region is None:
        return None
    if box is None:
        return new_region_box(collection, region, root_of(collection))
    if box.library:
        raise CaptureError(
            box.name, "", "the capture is in another file", "fit the region box there"
        )
    place_box(box, region, root_of(collection))
    return box


def photo_cameras(collection: bpy.types.Collection) -> list[bpy.types.Object]:
    """The collection's camera objects that have a photo behind them."""
    return [item for item in collection.all_objects if _has_photo(item)]


def shown_twice(collection: bpy.types.Collection) -> str:
    """Which cameras have one photo, as a sentence: one was duplicated; empty if none have."""
    seen: dict[Path, str] = {}
    for item in photo_cameras(collection):
        other = seen.setdefault(photo_path(photo_of(item)), item.name)
        if other != item.name:
            return (
                f"{other} and {item.name} have the same photo; delete the copy, or move it out of "
                f"{collection.name}."
            )
    return ""


def _has_photo(item: bpy.types.Object) -> bool:
    return item.type == "CAMERA" and photo_of(item) is not None


def _capture_name(capture: Capture) -> str:
    return f"Capture {capture.source.parent.name}"
