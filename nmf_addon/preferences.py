"""Preferences: where the solver's Python is and how it is set up."""

from __future__ import annotations

import bpy

from .names import BASE_PACKAGE
from .runtime import RuntimeMissing, managed_runtime, runtime_record, solver_python
from .setup_monitor import setup_state


class NMF_preferences(bpy.types.AddonPreferences):
    """Settings of the extension."""

    bl_idname = BASE_PACKAGE

    python: bpy.props.StringProperty(
        name="Own Python",
        description="A Python that has the solver's packages; leave empty to use the one built here",
        subtype="FILE_PATH",
    )
    wheelhouse: bpy.props.StringProperty(
        name="Wheelhouse",
        description="Folder with downloaded packages, for machines without a network",
        subtype="DIR_PATH",
    )
    pip_arguments: bpy.props.StringProperty(
        name="pip Arguments",
        description="More arguments for pip, such as the index of another build of torch",
    )

    def draw(self, context: bpy.types.Context) -> None:
        """The preferences page."""
        layout = self.layout
        state = setup_state()
        try:
            layout.label(text=f"Solver ready: {solver_python(self.python)}", icon="CHECKMARK")
        except RuntimeMissing as error:
            layout.label(text=str(error), icon="ERROR")
        record = runtime_record()
        if record:
            layout.label(
                text=f"Built with Python {record.get('python')}, torch {record.get('torch')}"
            )
        layout.label(text=f"Built in {managed_runtime()} (about 2 GB, removed with the extension)")
        row = layout.row()
        if state.running:
            row.progress(text=state.text, factor=state.fraction, type="BAR")
            row.operator("nmf.cancel_setup", icon="X")
        else:
            row.operator("nmf.setup_solver", icon="IMPORT")
        if state.error:
            for line in state.error.splitlines()[-6:]:
                layout.label(text=line, icon="BLANK1")
        column = layout.column()
        column.use_property_split = True
        column.prop(self, "python")
        column.prop(self, "wheelhouse")
        column.prop(self, "pip_arguments")


def preferences() -> NMF_preferences | None:
    """The extension's preferences; None where it was loaded without being an add-on."""
    addon = bpy.context.preferences.addons.get(BASE_PACKAGE)
    return addon.preferences if addon is not None else None


def chosen_python() -> str:
    """The Python the person chose; empty if none."""
    own = preferences()
    return bpy.path.abspath(own.python) if own is not None and own.python else ""


classes = (NMF_preferences,)
