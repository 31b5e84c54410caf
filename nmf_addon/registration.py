"""Everything that is added to Blender, and taken away again."""

from __future__ import annotations

import bpy

from ..operators import (
    import_capture,
    install_result,
    job_files,
    match_solver,
    reconstruct,
    region,
    relight,
    setup_solver,
)
from . import panels, preferences, properties, setup_monitor, thumbnails
from .jobs import monitor
from .names import BASE_PACKAGE

_class_modules = (
    properties, preferences, import_capture, region, reconstruct, install_result, relight,
    match_solver, job_files, setup_solver, panels,
)  # fmt: skip
_hooks = (properties, thumbnails)
_classes = [cls for module in _class_modules for cls in module.classes]
_command = None


def register() -> None:
    """Register classes, properties, menu entries and the command `nmf`."""
    global _command
    for cls in _classes:
        # Loaded from a checkout there is no add-on for the preferences to belong to.
        if (
            cls is preferences.NMF_preferences
            and BASE_PACKAGE not in bpy.context.preferences.addons
        ):
            continue
        bpy.utils.register_class(cls)
    for module in _hooks:
        module.register()
    bpy.types.TOPBAR_MT_file_import.append(import_capture.draw_menu)
    _command = bpy.utils.register_cli_command("nmf", _run_command)


def unregister() -> None:
    """Undo `register`, in reverse."""
    global _command
    if _command is not None:
        bpy.utils.unregister_cli_command(_command)
        _command = None
    bpy.types.TOPBAR_MT_file_import.remove(import_capture.draw_menu)
    for module in (monitor, setup_monitor, *reversed(_hooks)):
        module.unregister()
    for cls in reversed(_classes):
        if cls.is_registered:
            bpy.utils.unregister_class(cls)


def _run_command(arguments: list[str]) -> int:
    from . import headless

    return headless.main(arguments)
