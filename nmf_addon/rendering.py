"""Whether Blender renders, and nothing is to change."""

import bpy


def is_rendering() -> bool:
    """True while it renders or bakes in a thread of its own."""
    return any(map(bpy.app.is_job_running, ("RENDER", "OBJECT_BAKE")))
