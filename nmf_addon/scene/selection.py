"""What is selected and active."""

from __future__ import annotations

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
    return item.select_get(view_layer=view_layer)
