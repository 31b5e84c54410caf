"""Cycles pictures of the installed asset, for the demo: at given cameras, and as a turntable."""

from __future__ import annotations

import dataclasses
import importlib
import math
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix


def render_cameras(
    package, context: bpy.types.Context, cameras: list, folder: Path, samples: int = 64,
    root: bpy.types.Object | None = None, progress: Callable[[int, int], None] | None = None,
) -> list[Path]:  # fmt: skip
    """Render each camera with the scene's settings to NAME.exr (linear RGBA) and NAME.png.

    Args:
        package: the extension's. cameras: of its `Camera`.
        root: the capture's transform, under which the cameras stand.
    """
    parts = f"{package.__name__}.nmf_addon.scene"
    in_scene = importlib.import_module(f"{parts}.cameras")
    match_resolution = importlib.import_module(f"{parts}.match_solver").match_resolution
    scene = context.scene
    before = scene.camera
    scene.cycles.samples = samples
    files = []
    for done, camera in enumerate(cameras):
        item = in_scene.add_camera(camera, None)
        item.parent = root
        scene.collection.objects.link(item)
        scene.camera = item
        match_resolution(scene, camera.width, camera.height, in_scene.aspect_of(camera))
        files.append(_render(scene, folder / camera.name))
        data = item.data
        bpy.data.objects.remove(item)
        bpy.data.cameras.remove(data)
        if progress is not None:
            progress(done + 1, len(cameras))
    scene.camera = before
    return files


def turntable(
    package, context: bpy.types.Context, camera, centre, folder: Path, frames: int = 8,
    samples: int = 32, progress: Callable[[int, int], None] | None = None,
) -> list[Path]:  # fmt: skip
    """Render `camera` turned about the vertical axis through `centre`, `frames` times."""
    to_centre = Matrix.Translation(centre)
    views = []
    for frame in range(frames):
        turn = to_centre @ Matrix.Rotation(2 * math.pi * frame / frames, 4, "Z") @ to_centre.inverted()
        pose = np.array(turn) @ camera.camera_to_world
        views.append(dataclasses.replace(camera, name=f"turn_{frame:02d}", camera_to_world=pose))
    return render_cameras(package, context, views, folder, samples, None, progress)


def _render(scene: bpy.types.Scene, stem: Path) -> Path:
    image = scene.render.image_settings
    image.file_format, image.color_mode, image.color_depth = "OPEN_EXR", "RGBA", "32"
    path = stem.with_name(stem.name + ".exr")
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    image.file_format, image.color_mode, image.color_depth = "PNG", "RGBA", "8"
    bpy.data.images["Render Result"].save_render(str(stem.with_name(stem.name + ".png")))
    return path
