"""When operators can be used."""

import bpy

from ..nmf_addon.scene.capture_collection import active_capture


class WithCapture:
    """For operators that need a capture in the scene."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """With a capture."""
        cls.poll_message_set("Import a capture first")
        return active_capture(context) is not None
