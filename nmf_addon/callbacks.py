"""Functions that Blender calls: handlers of events, and timers."""

from collections.abc import Callable

import bpy


def detach(handler: Callable, *lists: list) -> None:
    """Take a handler out of lists of `bpy.app.handlers`, those that have it."""
    for handlers in lists:
        if handler in handlers:
            handlers.remove(handler)


def start_timer(tick: Callable[[], float | None], seconds: float) -> None:
    """Call a function after so many seconds, also if another file is opened, unless it is to be already."""
    if not bpy.app.timers.is_registered(tick):
        bpy.app.timers.register(tick, first_interval=seconds, persistent=True)


def stop_timer(tick: Callable[[], float | None]) -> None:
    if bpy.app.timers.is_registered(tick):
        bpy.app.timers.unregister(tick)
