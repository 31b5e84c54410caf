"""Build the solver's private Python environment."""

from __future__ import annotations

import bpy

from ..nmf_addon import preferences
from ..nmf_addon.setup_monitor import cancel_setup, setup_state, start_setup


class NMF_OT_setup_solver(bpy.types.Operator):
    """Download the solver's packages (about 2 GB) into a private folder of this extension"""

    bl_idname = "nmf.setup_solver"
    bl_label = "Set Up Solver"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """While none runs."""
        cls.poll_message_set("The set-up is running")
        return not setup_state().running

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the set-up."""
        own = preferences.preferences()
        wheelhouse = bpy.path.abspath(own.wheelhouse) if own is not None and own.wheelhouse else ""
        if not wheelhouse and not bpy.app.online_access:
            self.report(
                {"ERROR"}, "Online access is off: allow it in Preferences › System › Network"
            )
            return {"CANCELLED"}
        start_setup(wheelhouse, own.pip_arguments if own is not None else "")
        return {"FINISHED"}


class NMF_OT_cancel_setup(bpy.types.Operator):
    """Stop the set-up; an older runtime stays as it was"""

    bl_idname = "nmf.cancel_setup"
    bl_label = "Cancel Set-Up"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Stop it."""
        cancel_setup()
        return {"FINISHED"}


classes = (NMF_OT_setup_solver, NMF_OT_cancel_setup)
