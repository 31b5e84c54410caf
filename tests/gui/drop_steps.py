"""Runs inside a real Blender's window (`real-blender.sh gui`): files and folders dropped into it.

Writes screenshots and `dropped.json` to the folder NMF_GUI_OUT.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import bpy

OUT = Path(os.environ["NMF_GUI_OUT"])
CAPTURES = [Path(path) for path in os.environ["NMF_GUI_CAPTURES"].split(os.pathsep)]
DRAG_SOURCE = os.environ["NMF_GUI_DRAG_SOURCE"]
LIBRARIES = os.environ["NMF_GUI_DRAG_LIBRARIES"]
report = {}


def captures():
    names = (item.name for item in bpy.data.collections)
    return sorted(name for name in names if name.startswith("Capture "))


def drop(ui, x, y, *paths):
    """Drop onto a point of the screen, from its lower left corner as Blender's regions have it."""
    height = bpy.context.window_manager.windows[0].height
    source = subprocess.Popen(
        [sys.executable, DRAG_SOURCE, str(x), str(height - y), *map(str, paths)],
        env={**os.environ, "PYTHONPATH": LIBRARIES},
    )
    yield from ui.wait(lambda: source.poll() is not None, 20)
    yield 2.0
    return source.poll() == 0


def without_distortion(capture):
    """Whether an undistorted copy stands behind each camera of a capture."""
    cameras = [i for i in bpy.data.collections[capture].all_objects if i.type == "CAMERA"]
    shown = [b.image for i in cameras for b in i.data.background_images if b.show_background_image]
    return len(shown) == len(cameras) and all("nmf_undistorted" in image for image in shown)


def centre(region):
    return region.x + region.width // 2, region.y + region.height // 2


def steps(ui):
    (OUT / "dropped.json").unlink(missing_ok=True)
    ui.sidebar("NMF")
    yield 1.0
    view, tab = ui.region("VIEW_3D", "WINDOW"), ui.region("VIEW_3D", "UI")

    report["view"] = [(yield from drop(ui, *centre(view), CAPTURES[0])), captures()]
    ui.shot(str(OUT / "dropped.png"))
    ui.move(400, 500)
    yield 0.2
    ui.key("ctrl+z")
    yield 1.0
    report["undone"] = captures()
    report["folder"] = [(yield from drop(ui, *centre(view), CAPTURES[0].parent)), captures()]
    report["tab"] = [(yield from drop(ui, *centre(tab), CAPTURES[0])), captures()]
    report["two"] = [(yield from drop(ui, *centre(view), *CAPTURES[1:3])), captures()]

    with ui.override():
        bpy.ops.nmf.import_capture("INVOKE_DEFAULT")
    yield 1.5
    window = bpy.context.window_manager.windows[-1]
    area = window.screen.areas[0]
    region = next(region for region in area.regions if region.type == "WINDOW")
    x, y = centre(region)
    taken = yield from drop(ui, window.x + x, window.y + y, CAPTURES[3].parent)
    ui.shot(str(OUT / "dropped_folder.png"))
    with bpy.context.temp_override(window=window, area=area, region=region):
        bpy.ops.file.execute()
    yield 2.0
    report["browser"] = [taken, captures()]
    report["copies"] = yield from ui.wait(lambda: without_distortion("Capture urn"), 20)
    ui.move(400, 500)
    yield 0.2
    ui.key("ctrl+z")
    yield 1.0
    report["browser undone"] = captures()
    (OUT / "dropped.json").write_text(json.dumps(report))
