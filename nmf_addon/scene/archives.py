"""Archives that a person picks or drops."""

from collections.abc import Sequence
from pathlib import Path

import bpy

from ...solver.capture.archives import is_archive, unpacked


def unpack_all(context: bpy.types.Context, paths: Sequence[Path | None]) -> list[Path | None]:
    """The paths, with the folder of each archive instead of it; how far that is stands at the pointer.

    Raises:
        CaptureError: as `unpacked`.
    """
    manager = context.window_manager
    return [_unpack(manager, path) if path and is_archive(path) else path for path in paths]


def _unpack(progress: bpy.types.WindowManager, path: Path) -> Path:
    progress.progress_begin(0, 1)
    try:
        return unpacked(path, progress.progress_update)
    finally:
        progress.progress_end()
