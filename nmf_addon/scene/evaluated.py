"""Where objects are that Blender does not look at, because viewports do not show them."""

from collections.abc import Iterator
from contextlib import contextmanager

import bpy
from bpy.types import Collection, Object, Scene, ViewLayer

from .light_axes import AXES


@contextmanager
def evaluated(shown: Collection | Object) -> Iterator[None]:
    """An object, or all of a collection, stand where they are inside of this.

    Of a file that was opened, what is disabled in viewports or in another scene has no `matrix_world` but
    the identity, and none that follows a parent or an animation later on.
    """
    blocks = [block for block in _in_the_way(shown) if block.hide_viewport]
    for block in blocks:
        block.hide_viewport = False
    try:
        _view_layer_of(shown).update()
        yield
    finally:
        for block in blocks:
            block.hide_viewport = True


def settle(collection: Collection) -> None:
    """Let all objects of a collection have their `matrix_world`, as they stand now."""
    with evaluated(collection):
        pass


def _view_layer_of(shown: Collection | Object) -> ViewLayer:
    """The view layer that the person looks at, or one of a scene that has what that has not."""
    context = bpy.context
    there = [scene for scene in bpy.data.scenes if _is_in(shown, scene)]
    return context.view_layer if context.scene in there or not there else there[0].view_layers[0]


def _is_in(shown: Collection | Object, scene: Scene) -> bool:
    if isinstance(shown, Object):
        return scene in shown.users_scene
    return shown in (scene.collection, *scene.collection.children_recursive)


def _in_the_way(shown: Collection | Object) -> list[Collection | Object]:
    """What may hide it: itself, what is in it, and collections around all that."""
    if isinstance(shown, Object):
        collections, items = set(), {shown}
    else:
        collections, items = {shown, *shown.children_recursive}, set(shown.all_objects)
        # What something hangs on is evaluated with that. Once it was seen, Blender would go on drawing
        # lines to it from all that hang on it; and nobody asks where the axes of lights are.
        items -= {item.parent for item in items} | {item for item in items if AXES in item}
    around = {
        c for c in bpy.data.collections if collections & set(c.children_recursive) or items & set(c.objects)
    }
    return [*collections, *around, *items]
