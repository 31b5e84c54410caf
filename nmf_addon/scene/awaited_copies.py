"""Upright, undistorted copies of photos, made after an import, one at a time: nobody waits for them.

Until its copy is there, a photo stands behind its camera as it is. What is awaited is marked on objects, so
an undo, or a file that was saved too early, loses none.
"""

import logging
from collections.abc import Iterable

import bpy
from bpy.app.handlers import persistent
from mathutils import Matrix

from ..names import BASE_PACKAGE
from ..redraw import redraw_panels
from .background import undistorted_copy
from .cameras import photo_of, show_behind, to_solver

AWAITS = "nmf_awaits_copy"
AT_ONCE = bpy.app.background
"""nobody waits there, and no timer runs"""
PAUSE, PAUSE_IN_RENDER = 0.02, 1.0
"""seconds that Blender has for others between two"""

_log = logging.getLogger(BASE_PACKAGE)


def await_copies(items: Iterable[bpy.types.Object]) -> None:
    """Begin to make copies for camera objects, of photos that are not as their cameras saw them."""
    for item in items:
        item[AWAITS] = True
    while AT_ONCE and make_next():
        pass
    _go_on()


def awaiting(items: Iterable[bpy.types.Object]) -> list[bpy.types.Object]:
    """Those of some objects that wait for their copies."""
    return [item for item in items if AWAITS in item and item.library is None and item.users > 0]


def make_next() -> bool:
    """Make a copy that is awaited, and show it; False if there is none."""
    item = next(iter(awaiting(bpy.data.objects)), None)
    if item is None:
        return False
    del item[AWAITS]
    try:
        camera = to_solver(item, Matrix.Identity(4))
        show_behind(item, undistorted_copy(camera, photo_of(item)))
    except Exception as error:  # a photo that is gone or damaged is no reason to leave out others
        _log.warning("%s: its photo is shown as it is (%s)", item.name, error)
    return True


def _tick() -> float | None:
    if bpy.app.is_job_running("RENDER"):
        return PAUSE_IN_RENDER
    made = make_next()
    redraw_panels()
    return PAUSE if made else None


@persistent
def _go_on(*_) -> None:
    """Make what is awaited: by an import, a file that was opened, or a state that undo has come back to."""
    if not bpy.app.timers.is_registered(_tick) and awaiting(bpy.data.objects):
        bpy.app.timers.register(_tick, first_interval=PAUSE, persistent=True)


def _handlers() -> tuple[list, ...]:
    at = bpy.app.handlers
    return at.load_post, at.undo_post, at.redo_post


def register() -> None:
    """Watch for what is awaited."""
    for handler in _handlers():
        handler.append(_go_on)


def unregister() -> None:
    """Stop watching; what is awaited stays so."""
    for handler in _handlers():
        if _go_on in handler:
            handler.remove(_go_on)
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)
