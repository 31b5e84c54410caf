"""Panels whose text has changed without an event that Blender knows of."""

import bpy


def redraw_panels() -> None:
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if region.type == "UI":
                        region.tag_redraw()


def is_rendering() -> bool:
    """True while Blender renders or bakes."""
    return any(map(bpy.app.is_job_running, ("RENDER", "OBJECT_BAKE")))
