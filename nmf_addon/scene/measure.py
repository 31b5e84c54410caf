"""Metric scale: two points of a known distance."""

from bpy.types import Collection, Context, Object
from mathutils import Matrix, Vector

from .capture_collection import SOURCE, active_capture, capture_collections, root_of
from .evaluated import settle

LEAST = 1e-6  # distance of two points, Blender units


class MeasureError(ValueError):
    """There are no two points to measure between; one sentence with the way out."""


def picked_capture(context: Context) -> Collection:
    """The capture that what the person picked hangs on, else the active one."""
    # What was imported goes before collections that captures were sorted into.
    captures = sorted(capture_collections(context.scene), key=lambda c: SOURCE not in c)
    edited = _edited_mesh(context)
    for item in context.selected_objects if edited is None else [edited]:
        above = [item]
        while above[-1].parent is not None:
            above.append(above[-1].parent)
        for collection in captures:
            if root_of(collection) in above or item in set(collection.all_objects):
                return collection
    return active_capture(context)


def picked_points(context: Context) -> tuple[Vector, Vector]:
    """World positions of the two points the person picked.

    In Edit Mode the two selected vertices of the mesh, else the origins of the two selected objects.

    Raises:
        MeasureError: there are not two.
    """
    item = _edited_mesh(context)
    if item is not None:
        item.update_from_editmode()
        points = [item.matrix_world @ v.co for v in item.data.vertices if v.select]
        what = "vertices"
    else:
        points = [item.matrix_world.translation.copy() for item in context.selected_objects]
        what = "objects"
    if len(points) != 2:
        raise MeasureError(
            f"Two {what} are needed, not {len(points)}; select two vertices in Edit Mode, or two objects."
        )
    if (points[0] - points[1]).length < LEAST:
        raise MeasureError("The two points are in the same place; select two that are apart.")
    return points[0], points[1]


def _edited_mesh(context: Context) -> Object | None:
    item = context.active_object
    return item if item is not None and item.type == "MESH" and item.mode == "EDIT" else None


def scale_to(collection: Collection, points: tuple[Vector, Vector], distance: float) -> float:
    """Scale a capture about the first point so that its two points are `distance` apart (metres).

    Cameras, region, mesh and points hang on the capture's empty and follow. Returns the factor.

    Raises:
        MeasureError: the capture has no empty of ours, or one that cannot be scaled here.
    """
    root = root_of(collection)
    if root is None:
        raise MeasureError(
            f"{collection.name} has no transform empty; scale its cameras by hand, or import it."
        )
    if root.library:
        raise MeasureError(
            f"{collection.name} is linked from another file; scale it there, or make a library override."
        )
    settle(collection)
    first, second = points
    factor = distance / (second - first).length
    about = Matrix.Translation(first) @ Matrix.Scale(factor, 4) @ Matrix.Translation(-first)
    root.matrix_world = about @ root.matrix_world
    for data in {item.data for item in collection.all_objects if item.type == "CAMERA"}:
        if not data.library:
            for name in ("clip_start", "clip_end", "display_size"):
                setattr(data, name, factor * getattr(data, name))
    return factor
