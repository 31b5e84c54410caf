"""A capture in the scene: a collection of cameras under one empty, with a region box.

The empty carries the similarity transform (up, scale, origin) from capture space to the world; the
collection is the truth the solver is started from.
"""

import math
from pathlib import Path

import bpy
from bpy.types import Collection, Context, Object, Scene
from mathutils import Matrix, Quaternion, Vector

from ...solver.capture.errors import CaptureError
from ...solver.capture.formats.transforms import write_transforms
from .cameras import photo_of, photo_path, to_solver
from .evaluated import settle

SOURCE, ROOT, WARNINGS = "nmf_source", "nmf_root", "nmf_warnings"
FILE_TO_CAPTURE = "nmf_file_to_capture"
JOBS = "nmf_last_job"
"""names of the job folders that the capture was reconstructed in, a line each, the last one last"""


def jobs_of(collection: Collection) -> list[str]:
    """Names of the job folders that a capture was reconstructed in, the last one last."""
    return str(collection.get(JOBS, "")).splitlines()


def remember_job(collection: Collection, name: str) -> None:
    """Let a capture know a job folder that it is reconstructed in."""
    if not collection.library:
        collection[JOBS] = "\n".join([*(other for other in jobs_of(collection) if other != name), name])


def warnings_of(collection: Collection) -> list[str]:
    """What reading the capture had to say."""
    return [str(text) for text in collection.get(WARNINGS, ())]


def capture_collections(scene: Scene) -> list[Collection]:
    """Collections of the scene that hold at least one camera with a photo."""
    holding: set[Collection] = set()

    def look_into(collection: Collection) -> bool:
        # The panel asks in every draw: objects are looked at once, not for each collection around them.
        below = [look_into(child) for child in collection.children]
        if any(below) or any(map(_has_photo, collection.objects)):
            holding.add(collection)
        return collection in holding

    look_into(scene.collection)
    return [c for c in scene.collection.children_recursive if c in holding]


def is_capture(collection: Collection) -> bool:
    return any(_has_photo(item) for item in collection.all_objects)


def active_capture(context: Context) -> Collection | None:
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


def capture_of_number(number: int) -> Collection | None:
    """The collection of a `session_uid`, which renaming and Undo leave as it is, and which may be a scene's
    own; None if it is gone."""
    all_there = (*bpy.data.collections, *(scene.collection for scene in bpy.data.scenes))
    return next((c for c in all_there if c.session_uid == number), None)


def scene_of(collection: Collection, first: Scene | None = None) -> Scene | None:
    """The first scene that a collection is in: `first`, if it is in that, else by name."""
    there = [s for s in bpy.data.scenes if collection in s.collection.children_recursive]
    return first if first in there else next(iter(there), None)


def root_of(collection: Collection) -> Object | None:
    """The empty with the capture's similarity transform; None for foreign cameras."""
    return next((item for item in collection.all_objects if item.get(ROOT)), None)


def to_capture_space(collection: Collection) -> Matrix:
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


def placement_of(collection: Collection) -> list[list[float]]:
    """Rows of the similarity [4][4] from capture space to the world; where a person has scaled the empty
    unevenly, with the mean of its scales; where it is mirrored, so is its X back."""
    root = root_of(collection)
    if root is None:
        return [list(row) for row in Matrix.Identity(4)]
    settle(collection)
    place, turn, scale = root.matrix_world.decompose()
    even = abs(math.prod(scale)) ** (1 / 3)
    if scale.x < 0:  # `decompose` mirrors all three, which would stand it on its head
        turn @= Quaternion((0.0, 1.0, 0.0, 0.0))
    return [list(row) for row in Matrix.LocRotScale(place, turn, Vector((even, even, even)))]


def write_capture(collection: Collection, folder: Path) -> Path:
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


def photo_paths(collection: Collection) -> set[Path]:
    return {photo_path(photo_of(item)).resolve() for item in photo_cameras(collection)}


def photo_cameras(collection: Collection) -> list[Object]:
    return [item for item in collection.all_objects if _has_photo(item)]


def shown_twice(collection: Collection) -> str:
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


def _has_photo(item: Object) -> bool:
    return item.type == "CAMERA" and photo_of(item) is not None
