"""Cycles pictures of the installed asset: at given cameras, and as a turntable."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

from ...solver.capture.camera import Camera
from .cameras import add_camera, aspect_of
from .match_solver import match_resolution


def render_cameras(
    context: bpy.types.Context, cameras: list[Camera], folder: Path, samples: int = 64,
    root: bpy.types.Object | None = None, progress: Callable[[int, int], None] | None = None,
) -> list[Path]:  # fmt: skip
    """Render each camera with the scene's settings to NAME.exr (linear RGBA) and NAME.png.

    Args:
        root: the capture's transform, under which the cameras stand.
    """
    scene = context.scene
    before = scene.camera
    scene.cycles.samples = samples
    files = []
    for done, camera in enumerate(cameras):
        item = add_camera(camera, None)
        item.parent = root
        scene.collection.objects.link(item)
        scene.camera = item
        match_resolution(scene, camera.width, camera.height, aspect_of(camera))
        files.append(_render(scene, folder / camera.name))
        data = item.data
        bpy.data.objects.remove(item)
        bpy.data.cameras.remove(data)
        if progress is not None:
            progress(done + 1, len(cameras))
    scene.camera = before
    return files


def turntable(
    context: bpy.types.Context, camera: Camera, centre, folder: Path, frames: int = 8,
    samples: int = 32, progress: Callable[[int, int], None] | None = None,
) -> list[Path]:  # fmt: skip
    """Render `camera` turned about the vertical axis through `centre`, `frames` times."""
    to_centre = Matrix.Translation(centre)
    views = []
    for frame in range(frames):
        turn = (
            to_centre @ Matrix.Rotation(2 * math.pi * frame / frames, 4, "Z") @ to_centre.inverted()
        )
        pose = np.array(turn) @ camera.camera_to_world
        views.append(dataclasses.replace(camera, name=f"turn_{frame:02d}", camera_to_world=pose))
    return render_cameras(context, views, folder, samples, None, progress)


def _render(scene: bpy.types.Scene, stem: Path) -> Path:
    image = scene.render.image_settings
    image.file_format, image.color_mode, image.color_depth = "OPEN_EXR", "RGBA", "32"
    path = stem.with_name(stem.name + ".exr")
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    image.file_format, image.color_mode, image.color_depth = "PNG", "RGBA", "8"
    bpy.data.images["Render Result"].save_render(str(stem.with_name(stem.name + ".png")))
    return path
