"""Runs inside a real Blender's window: a film is tracked, solved and used, as a matchmover would."""

import json
import os
from pathlib import Path

import bpy

OUT = Path(os.environ["NMF_GUI_OUT"])
FILM = Path(os.environ["NMF_GUI_FILM"])
"""a numbered film's first picture; beside it film.json, with places of tracks (x, y by frame) and the lens"""
report = {}


def steps(ui):
    """Track in the clip editor, set the scene up, press Use Moving Camera and OK."""
    (OUT / "film_report.json").unlink(missing_ok=True)
    stated = json.loads(FILM.with_name("film.json").read_text())
    clip = bpy.data.movieclips.load(str(FILM))
    tracking = clip.tracking
    tracking.camera.sensor_width, tracking.camera.focal_length = 36.0, stated["lens"]
    tracking.camera.k1 = stated["k1"]
    for number, places in enumerate(stated["tracks"]):
        track = tracking.tracks.new(name=f"t{number}", frame=1)
        for frame, place in enumerate(places, start=1):
            track.markers.insert_frame(frame, co=place)
    camera = next(item for item in tracking.objects if item.is_camera)
    camera.keyframe_a, camera.keyframe_b = 1, clip.frame_duration // 2
    area = ui.area("VIEW_3D")
    area.type = "CLIP_EDITOR"
    yield 0.5
    area.spaces.active.clip = clip
    region = next(region for region in area.regions if region.type == "WINDOW")
    window = bpy.context.window_manager.windows[0]
    with bpy.context.temp_override(window=window, area=area, region=region):
        bpy.ops.clip.solve_camera("EXEC_DEFAULT")
        report["error"] = camera.reconstruction.average_error
        bpy.ops.clip.setup_tracking_scene()
    area.type = "VIEW_3D"
    bpy.context.scene.frame_set(1)
    bpy.context.view_layer.objects.active = bpy.context.scene.camera
    ui.sidebar("NMF")
    yield 1.0
    ui.shot(str(OUT / "film_1_tracked.png"))
    yield from ui.press("nmf.use_moving_camera")
    yield 1.0
    ui.shot(str(OUT / "film_2_dialog.png"))
    ui.key("Return")
    yield from ui.wait(lambda: bpy.context.scene.nmf.capture is not None, 10)
    yield 1.0
    ui.shot(str(OUT / "film_3_capture.png"))
    cameras = [item for item in bpy.context.scene.nmf.capture.objects if item.type == "CAMERA"]
    report["poses"] = {item.name: [list(row) for row in item.matrix_world] for item in cameras}
    report["distortion"] = list(cameras[0].data["nmf_distortion"])
    report["frame"] = bpy.context.scene.frame_current
    ui.move(400, 500)
    yield 0.2
    ui.key("ctrl+z")
    yield 1.0
    report["after_undo"] = [item.name for item in bpy.data.objects if item.type == "CAMERA"]
    (OUT / "film_report.json").write_text(json.dumps(report))
    yield 0.5
