"""The job's preview picture as an icon for the panel."""

from __future__ import annotations

import bpy
import bpy.utils.previews

_pictures = None
_shown = ("", 0)


def preview_icon(monitor) -> int:
    """Icon number of the newest preview of the monitor's job; 0 if there is none."""
    global _shown
    if monitor.job is None or _pictures is None:
        return 0
    path = monitor.job.preview_dir / "render.png"
    version = (str(path), monitor.model.preview_version)
    if version[1] == 0:
        return 0
    if version != _shown or "preview" not in _pictures:
        _pictures.clear()
        _pictures.load("preview", str(path), "IMAGE")
        _shown = version
    return _pictures["preview"].icon_id


def register() -> None:
    """Make the collection of pictures."""
    global _pictures
    _pictures = bpy.utils.previews.new()


def unregister() -> None:
    """Free it."""
    global _pictures
    if _pictures is not None:
        bpy.utils.previews.remove(_pictures)
        _pictures = None
