"""Preferences: where the solver's Python is and how it is set up."""

from __future__ import annotations

from pathlib import Path

import bpy

from . import runtime
from .compat import PATH_OPTIONS
from .names import BASE_PACKAGE
from .setup_monitor import setup_state
from .wrapping import fields, letters, paragraph

SIZE_TEXT = "1 to 4 GB"
CANCEL = 2.5  # button heights that the bar's ends and the button beside it take


# Blender evaluates the annotations below where lambdas would not find this module's names.
def _look_again(self: NMF_preferences, context: bpy.types.Context) -> None:
    runtime.forget()


def _path(name: str, subtype: str, description: str, **more):
    return bpy.props.StringProperty(
        name=name, description=description, subtype=subtype, options=PATH_OPTIONS, **more
    )


class NMF_preferences(bpy.types.AddonPreferences):
    """Settings of the extension."""

    bl_idname = BASE_PACKAGE

    python: _path(
        "Own Python", "FILE_PATH",
        "A Python that has the solver's packages; leave empty to use the one built here",
        update=_look_again,
    )  # fmt: skip
    runtime_folder: _path(
        "Folder", "DIR_PATH",
        "Where the solver is set up; leave empty for the extension's own folder, which is deleted with it "
        "(on Windows for one in AppData\\Local, which stays)",
        update=_look_again,
    )  # fmt: skip
    base_python: _path(
        "Build With", "FILE_PATH",
        "Python 3.11 to 3.13 to set up the solver with; leave empty to use Blender's",
    )  # fmt: skip
    wheelhouse: _path(
        "Wheelhouse", "DIR_PATH", "Folder with downloaded packages, for computers without a network"
    )
    pip_arguments: bpy.props.StringProperty(
        name="pip Arguments",
        description="Extra arguments for pip, such as the index of another PyTorch build",
    )

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        python, problem = runtime.solver_state(chosen("python"), chosen("runtime_folder"))
        box = layout.box()
        if python is not None:
            box.label(text="The solver is ready", icon="CHECKMARK")
            detail = box.column(align=True)
            detail.active = False
            detail.label(text=str(python), icon="BLANK1")
            record = runtime.runtime_record(chosen("runtime_folder"))
            if record and not self.python:
                versions = f"Python {record.get('python')}, torch {record.get('torch') or '–'}"
                detail.label(text=versions, icon="BLANK1")
        else:
            paragraph(box, context, problem, icon="ERROR")
        # While an own Python is wrong, what is set up here would not be used.
        offered = python is not None or not self.python
        if offered:
            draw_setup(box, context, again=python is not None)
        if offered and not setup_state().running:
            note = box.column()
            note.active = False
            folder = runtime.managed_runtime(chosen("runtime_folder"))
            paragraph(note, context, f"Downloads {SIZE_TEXT} into {folder}", icon="BLANK1")
        column = fields(layout, self)
        column.prop(self, "python", placeholder="Built by Set Up Solver")
        column.separator()
        column.label(text="Set-Up")
        column.prop(self, "runtime_folder", placeholder="The default folder")
        column.prop(self, "base_python", placeholder="Blender's Python")
        column.prop(self, "wheelhouse", placeholder="Download from the network")
        column.prop(self, "pip_arguments")


def draw_setup(layout: bpy.types.UILayout, context: bpy.types.Context, again: bool = False) -> None:
    """The set-up's button, progress or error, and what a check found; here and in the sidebar."""
    state = setup_state()
    if state.running:
        fits = len(state.text) <= letters(context, CANCEL)
        if not fits:
            paragraph(layout, context, state.text)
        row = layout.row(align=True)
        share = f"{100 * state.fraction:.0f} %"
        row.progress(text=state.text if fits else share, factor=state.fraction, type="BAR")
        row.operator("nmf.cancel_setup", text="", icon="X")
        return
    row = layout.row()
    row.operator("nmf.setup_solver", text="Set Up Again" if again else "Set Up Solver", icon="IMPORT")
    if again:
        row.operator("nmf.check_solver", icon="INFO")
    column = layout.column(align=True)
    if state.error:
        column.alert = True
        what = "The solver does not start:" if state.is_check else "The set-up failed:"
        paragraph(column, context, what, icon="ERROR")
        for line in state.error.splitlines()[-6:]:
            paragraph(column, context, line)
    elif state.is_check:
        for line in state.log:
            paragraph(column, context, line, icon="BLANK1")
    if state.error or (state.is_check and state.log):
        layout.operator("nmf.copy_setup_log", icon="COPYDOWN")


def preferences() -> NMF_preferences | None:
    """The extension's preferences; None where it was loaded without being an add-on."""
    addon = bpy.context.preferences.addons.get(BASE_PACKAGE)
    return addon.preferences if addon is not None else None


def chosen(name: str) -> str:
    """A path or text of the preferences, absolute if it is a path; empty if none."""
    own = preferences()
    value = getattr(own, name) if own is not None else ""
    return bpy.path.abspath(value) if value and name != "pip_arguments" else value


def solver_python() -> Path:
    """The Python that runs the solver.

    Raises:
        RuntimeMissing: there is none yet, with the way out.
    """
    return runtime.solver_python(chosen("python"), chosen("runtime_folder"))


classes = (NMF_preferences,)
