"""What is selected and active, and seen in Local View."""

import bpy


def make_active(item: bpy.types.Object, view_layer: bpy.types.ViewLayer) -> bool:
    """Select an object, and nothing else, where it is seen at all; False where it is not."""
    view_layer.update()
    if item.name not in view_layer.objects:
        return False
    for other in view_layer.objects.selected:
        other.select_set(False, view_layer=view_layer)
    item.select_set(True, view_layer=view_layer)
    view_layer.objects.active = item
    show_in_local_views(item)
    return item.select_get(view_layer=view_layer)


def show_in_local_views(item: bpy.types.Object) -> None:
    """Let 3D Views in Local View show an object, as Blender does with what is new."""
    for window in bpy.context.window_manager.windows:
        if window.view_layer.objects.get(item.name) != item:
            continue
        for area in window.screen.areas:
            for space in area.spaces:
                if space.type == "VIEW_3D" and space.local_view:
                    item.local_view_set(space, True)
