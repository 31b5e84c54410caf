"""What a result's light turns with: an empty beside the object that stays when the capture's goes.

It hangs on what the object hangs on. So both keep their places to each other when that is deleted or its
transform is applied (Ctrl+A), both move when it is turned, and the light stands still when the object alone
is turned.
"""

import bpy
from bpy.app.handlers import persistent
from bpy.types import Depsgraph, Object, Scene, World
from mathutils import Matrix

from ..callbacks import detach
from ..redraw import is_rendering
from .replace import JOB
from .world import turn_with, turns_with

AXES = "nmf_light_axes"
"""of such an empty, the job of its result, as the result's own `JOB` has it"""
RESULT = "Result"
"""name of its constraint, which does nothing but know the result's object; a pointer among the custom
properties would keep the object in the file after that was deleted"""


def light_by(world: World, item: Object, under: Object | None, local: Matrix) -> None:
    """Let a result's light turn with what the result's object hangs on.

    Args:
        under: what axes are to hang on if the result has none from an earlier installation; or None.
        local: from the light's coordinates to those of `under`.
    """
    axes = _axes_of(item) or (under and _new_axes(item))
    if axes is None:
        return
    axes[AXES], knows = item[JOB], axes.constraints[RESULT]
    if knows.target != item:
        knows.target, axes.parent, axes.matrix_local = item, under, local
        axes.matrix_parent_inverse = Matrix.Identity(4)
    turn_with(world, axes)


def _new_axes(item: Object) -> Object:
    axes = bpy.data.objects.new(f"{item.name} Light", None)
    axes[AXES] = item[JOB]
    axes.empty_display_type = "ARROWS"
    # What is not shown is not selected with all the rest, nor applied or deleted with it.
    axes.hide_viewport = axes.hide_render = True
    knows = axes.constraints.new("COPY_ROTATION")
    knows.name, knows.mute = RESULT, True
    for home in item.users_collection:
        home.objects.link(axes)
    return axes


def _axes_of(item: Object) -> Object | None:
    """A light's axes in its result's scenes, also if that was deleted or its job has moved."""
    there = {other for scene in item.users_scene for other in scene.objects if AXES in other}
    found = [
        o for o in there
        if not o.library and (_knows(o, item) or (o[AXES] == item[JOB] and _knows(o, None)))
    ]  # fmt: skip
    return next(iter(sorted(found, key=lambda o: not _knows(o, item))), None)


def _knows(axes: Object, *items: Object | None) -> bool:
    knows = axes.constraints.get(RESULT)
    return knows is not None and knows.target in items


def let_go() -> None:
    """Leave the light as it stands of every result whose object was taken off what both hung on.

    Else it would turn when that is deleted afterwards, as it is by a person who has cleared the object's
    parent to be rid of the capture.
    """
    for world in bpy.data.worlds:
        axes = turns_with(world)
        if axes is None or AXES not in axes or axes.library or axes.parent is None:
            continue
        knows = axes.constraints.get(RESULT)
        item = knows and knows.target
        if item and item.users_scene and item.parent != axes.parent:
            stands = axes.matrix_world.copy()
            axes.parent, axes.matrix_world = None, stands


@persistent
def _on_change(scene: Scene, graph: Depsgraph) -> None:
    # Blender renders and bakes in a thread, which calls this, too; nothing may be written then.
    if not is_rendering():
        let_go()


def register() -> None:
    """Watch for objects that are taken off their captures."""
    bpy.app.handlers.depsgraph_update_post.append(_on_change)


def unregister() -> None:
    detach(_on_change, bpy.app.handlers.depsgraph_update_post)
