"""The region box: an empty cube that says where the object is, for the person to move and scale."""

import bpy
import numpy as np
from mathutils import Matrix

from ...solver.capture.errors import CaptureError

REGION, PLACED = "nmf_region", "nmf_placed"
STRAIGHT = 1e-4  # one minus the cosine of what counts as not turned


def new_region_box(
    collection: bpy.types.Collection, region: np.ndarray, root: bpy.types.Object | None
) -> bpy.types.Object:
    """A box of capture space [2, 3] in a collection, under the capture's empty.

    Raises:
        CaptureError: nothing can be added to the collection in this file.
    """
    if collection.library or collection.override_library:
        raise CaptureError(
            collection.name, "", "the capture is in another file", "add the region box there"
        )
    box = bpy.data.objects.new(f"{collection.name} Region", None)
    box[REGION] = True
    # A region has the capture's axes; a turned box would show another one.
    box.lock_rotation = (True, True, True)
    box.empty_display_type, box.empty_display_size = "CUBE", 1.0
    collection.objects.link(box)
    place_box(box, region, root)
    return box


def place_box(box: bpy.types.Object, region: np.ndarray, root: bpy.types.Object | None) -> None:
    """Move a box to a region of capture space [2, 3], and remember that nobody has moved it since.

    Args:
        root: the capture's empty, of which the box may have been cleared.
    """
    box.parent = root
    box.matrix_parent_inverse.identity()
    low, high = np.asarray(region, dtype=np.float64)
    box.rotation_euler = (0.0, 0.0, 0.0)
    box.location, box.scale = (low + high) / 2, (high - low) / 2 / box.empty_display_size
    box[PLACED] = _state(box)


def is_as_placed(box: bpy.types.Object) -> bool:
    """True if nobody has moved, turned or scaled the box since it was placed."""
    return np.allclose(list(box.get(PLACED, ())) or np.nan, _state(box), rtol=1e-6, atol=0)


def region_box(collection: bpy.types.Collection) -> bpy.types.Object | None:
    """The collection's region box."""
    return next(iter(_region_boxes(collection)), None)


def region_problem(collection: bpy.types.Collection, to_capture: Matrix) -> str:
    """How the region differs from what a person sees, as a sentence; empty if it does not.

    Args:
        to_capture: world to capture space.
    """
    boxes = _region_boxes(collection)
    if not boxes:
        return ""
    if len(boxes) > 1:
        return (
            f"There are {len(boxes)} region boxes; only {boxes[0].name} counts; delete the others."
        )
    axes = np.array((to_capture @ boxes[0].matrix_world).to_3x3())
    lengths = np.linalg.norm(axes, axis=0)
    if (np.abs(axes).max(0) >= (1 - STRAIGHT) * lengths).all():
        return ""
    return (
        f"{boxes[0].name} is rotated, so the region is the unrotated box around it; set its rotation to 0 "
        "in the sidebar's Item tab."
    )


def _region_boxes(collection: bpy.types.Collection) -> list[bpy.types.Object]:
    return [item for item in collection.all_objects if item.get(REGION)]


def _state(box: bpy.types.Object) -> list[float]:
    return [*box.location, *box.rotation_euler, *box.scale]
