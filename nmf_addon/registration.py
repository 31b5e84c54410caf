"""Everything that is added to Blender, and taken away again."""

import bpy

from ..operators import (
    check_capture,
    import_capture,
    install_result,
    job_files,
    match_solver,
    reconstruct,
    region,
    relight,
    set_scale,
    setup_solver,
    show_photos,
    solve_cameras,
    use_moving_camera,
)
from . import panels, preferences, properties, runtime, setup_monitor, thumbnails
from .jobs import monitor, side_task
from .names import BASE_PACKAGE
from .scene import awaited_copies, light_axes

_class_modules = (
    properties, preferences, import_capture, solve_cameras, use_moving_camera, show_photos, region,
    set_scale, check_capture, reconstruct, install_result, relight, match_solver, job_files, setup_solver,
    panels,
)  # fmt: skip
_classes = [cls for module in _class_modules for cls in module.classes]
_undo: list = []


def register() -> None:
    """Register classes, properties, menu entries and the command `nmf`.

    If one of them fails, those before it are taken away again and the error goes on to Blender.
    """
    try:
        _register()
    except Exception:
        unregister()
        raise


def unregister() -> None:
    """Undo `register`, in reverse."""
    while _undo:
        _undo.pop()()
    runtime.forget()


def _register() -> None:
    for cls in _classes:
        # Loaded from a checkout there is no add-on for the preferences to belong to.
        is_addon = BASE_PACKAGE in bpy.context.preferences.addons
        if cls is preferences.NMF_preferences and not is_addon:
            continue
        bpy.utils.register_class(cls)
        _undo.append(lambda cls=cls: bpy.utils.unregister_class(cls))
    for module in (properties, thumbnails, monitor, side_task, awaited_copies, light_axes):
        module.register()
        _undo.append(module.unregister)
    _undo.append(setup_monitor.unregister)
    bpy.types.TOPBAR_MT_file_import.append(import_capture.draw_menu)
    _undo.append(lambda: bpy.types.TOPBAR_MT_file_import.remove(import_capture.draw_menu))
    command = bpy.utils.register_cli_command("nmf", _run_command)
    _undo.append(lambda: bpy.utils.unregister_cli_command(command))


def _run_command(arguments: list[str]) -> int:
    from . import headless

    return headless.main(arguments)
