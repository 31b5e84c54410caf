"""Upright, undistorted copies of photos, filled after an import, one at a time: nobody waits for them.

Until its turn comes, a photo stands behind its camera as it is. All data-blocks are the import's, for Undo
knows of no others; later they are but filled and shown.
"""

import logging
from collections.abc import Iterable

import bpy
from bpy.app.handlers import persistent
from bpy.types import Camera, Object
from mathutils import Matrix

from ..callbacks import detach, start_timer, stop_timer
from ..names import BASE_PACKAGE
from ..redraw import is_rendering, redraw_panels
from .background import empty_copy, fill_copy
from .cameras import copy_behind, keep_behind, photo_of, show_behind, to_solver

AWAITS = "nmf_awaits_copy"
"""on a camera's data"""
EMPTY = "GENERATED"
"""source of an image that never was filled, and packed"""
AT_ONCE = bpy.app.background
"""nobody waits there, and no timer runs"""
PAUSE, PAUSE_IN_RENDER = 0.02, 1.0
"""seconds that Blender has for others between two"""

_log = logging.getLogger(BASE_PACKAGE)


def await_copies(items: Iterable[Object]) -> None:
    """Give camera objects copies of photos that are not as cameras saw them, and begin to fill these."""
    for item in items:
        keep_behind(item.data, empty_copy(item.name))
        item.data[AWAITS] = True
    while AT_ONCE and make_next():
        pass
    _go_on()


def awaiting(items: Iterable[Object]) -> list[Object]:
    """Those of some objects that are cameras without their copies."""
    return [i for i in items if i.type == "CAMERA" and i.users and not i.data.library and _waits(i.data)]


def _waits(data: Camera) -> bool:
    copy = copy_behind(data)
    shown = any(b.show_background_image and b.image == copy for b in data.background_images)
    return copy is not None and (AWAITS in data or (shown and copy.source == EMPTY))


def make_next() -> bool:
    """Fill a copy that is awaited, and show it; False if there is none."""
    item = next(iter(awaiting(bpy.data.objects)), None)
    if item is None:
        return False
    copy = copy_behind(item.data)
    item.data.pop(AWAITS, None)
    try:
        # Undo may have taken back but one of both.
        if copy.source == EMPTY:
            fill_copy(copy, to_solver(item, Matrix.Identity(4)), photo_of(item))
        show_behind(item.data, copy)
    except Exception as error:  # a photo that is gone or damaged is no reason to leave out others
        _log.warning("%s: its photo is shown as it is (%s)", item.name, error)
    return True


def _tick() -> float | None:
    if is_rendering():
        return PAUSE_IN_RENDER
    made = make_next()
    redraw_panels()
    return PAUSE if made else None


@persistent
def _go_on(*_) -> None:
    """Make what is awaited by an import, a file that was opened, or a state that Undo came back to."""
    if awaiting(bpy.data.objects):
        start_timer(_tick, PAUSE)


def _handlers() -> tuple[list, ...]:
    at = bpy.app.handlers
    return at.load_post, at.undo_post, at.redo_post


def register() -> None:
    for handlers in _handlers():
        handlers.append(_go_on)


def unregister() -> None:
    """Stop watching; what is awaited stays so."""
    detach(_go_on, *_handlers())
    stop_timer(_tick)
