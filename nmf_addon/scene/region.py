"""The region box: an empty cube that says where the object is, for the person to move and scale."""

import bpy
import numpy as np
from bpy.types import Collection, Context, Object
from mathutils import Matrix

from ...solver.capture.capture import region_seen_by
from ...solver.capture.errors import CaptureError
from .cameras import to_solver
from .capture_collection import photo_cameras, root_of, to_capture_space
from .evaluated import settle
from .findings import check_report, masked_box

REGION, PLACED = "nmf_region", "nmf_placed"
STRAIGHT = 1e-4  # one minus the cosine of what counts as not turned


def new_region_box(collection: Collection, region: np.ndarray, root: Object | None) -> Object:
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


def place_box(box: Object, region: np.ndarray, root: Object | None) -> None:
    """Move a box to a region of capture space [2, 3], and remember that nobody has moved it since.

    Args:
        root: the capture's empty, of which the box may have been cleared.
    """
    box.parent = root
    box.matrix_parent_inverse.identity()
    low, high = np.asarray(region, dtype=np.float64)
    box.matrix_basis = Matrix.Identity(4)  # in whatever rotation mode
    box.location, box.scale = (low + high) / 2, (high - low) / 2 / box.empty_display_size
    box[PLACED] = _state(box)


def is_as_placed(box: Object) -> bool:
    """True if nobody has moved, turned or scaled the box since it was placed."""
    return np.allclose(list(box.get(PLACED, ())) or np.nan, _state(box), rtol=1e-6, atol=0)


def region_box(collection: Collection) -> Object | None:
    return next(iter(_region_boxes(collection)), None)


def region_problem(collection: Collection, to_capture: Matrix) -> str:
    """How the region differs from what a person sees, as a sentence; empty if it does not.

    Args:
        to_capture: world to capture space.
    """
    boxes = _region_boxes(collection)
    if not boxes:
        return ""
    if len(boxes) > 1:
        return f"There are {len(boxes)} region boxes; only {boxes[0].name} counts; delete the others."
    axes = np.array((to_capture @ boxes[0].matrix_world).to_3x3())
    lengths = np.linalg.norm(axes, axis=0)
    if (np.abs(axes).max(0) >= (1 - STRAIGHT) * lengths).all():
        return ""
    return (
        f"{boxes[0].name} is rotated, so the region is the unrotated box around it; set its rotation to 0 "
        "in the sidebar's Item tab."
    )


def add_region_box(context: Context, collection: Collection) -> Object:
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


def region_of(collection: Collection) -> dict[str, list[float]] | None:
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


def fit_region_box(collection: Collection) -> Object | None:
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
        raise CaptureError(box.name, "", "the capture is in another file", "fit the region box there")
    place_box(box, region, root_of(collection))
    return box


def _region_boxes(collection: Collection) -> list[Object]:
    return [item for item in collection.all_objects if item.get(REGION)]


def _state(box: Object) -> list[float]:
    return [*box.location, *box.matrix_basis.to_euler(), *box.scale]
