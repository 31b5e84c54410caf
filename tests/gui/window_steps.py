"""Runs inside a real Blender's window (`real-blender.sh gui`): the panel, used with the mouse.

Writes screenshots and `report.json` to the folder NMF_GUI_OUT.
"""

import json
import os
import sys
from pathlib import Path

import bpy

OUT = Path(os.environ["NMF_GUI_OUT"])
CAPTURE = os.environ["NMF_GUI_CAPTURE"]
PHONE_CAPTURE = Path(os.environ["NMF_GUI_PHONE_CAPTURE"])
VIDEO = Path(os.environ["NMF_GUI_VIDEO"])
MODULE = "bl_ext.user_default.neural_microfacet_fields"
report = {}


def job_monitor():
    return sys.modules[MODULE + ".nmf_addon.jobs.monitor"].monitor


def installed():
    return [item.name for item in bpy.data.objects if item.get("nmf_job")]


def render_frames():
    """Begin an animation that takes minutes, in a thread of Blender's."""
    scene = bpy.context.scene
    bpy.context.preferences.view.render_display_type = "NONE"
    scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", 64, False
    scene.render.resolution_x, scene.render.resolution_y, scene.frame_end = 160, 90, 2000
    scene.render.filepath = str(OUT / "frames" / "frame_")
    bpy.ops.render.render("INVOKE_DEFAULT", animation=True)


def steps(ui):
    (OUT / "report.json").unlink(missing_ok=True)
    area = ui.area("VIEW_3D")
    ui.sidebar("NMF")
    yield 1.0
    ui.shot(str(OUT / "1_no_capture.png"))

    def cameras():
        return [item.name for item in bpy.data.objects if item.type == "CAMERA"]

    def backgrounds():
        shown = (b for camera in bpy.data.cameras for b in camera.background_images)
        return sum(b.show_background_image and b.image.packed_file is not None for b in shown)

    report["cameras_before"] = cameras()
    os.environ["NMF_FAKE_MODE"] = "normal"
    yield from ui.press("nmf.solve_cameras")
    yield 1.0
    window = bpy.context.window_manager.windows[-1]
    browser = window.screen.areas[0]
    browser.spaces.active.params.directory = str(VIDEO.parent).encode()
    yield 1.0
    browser.spaces.active.params.filename = VIDEO.name
    yield 0.5
    ui.shot(str(OUT / "1_video.png"))
    region = next(region for region in browser.regions if region.type == "WINDOW")
    with bpy.context.temp_override(window=window, area=browser, region=region):
        bpy.ops.file.execute()
    task = sys.modules[MODULE + ".nmf_addon.jobs.side_task"].side_task
    yield from ui.wait(lambda: task.running, 5)
    yield from ui.wait(lambda: not task.running, 20)
    report["video"], report["video_capture"] = task.model.text, bpy.context.scene.nmf.capture.name
    ui.move(400, 500)
    yield 0.2
    ui.key("ctrl+z")
    yield 1.0
    report["after_video_undo"] = cameras() == report["cameras_before"]

    with ui.override():
        # As a drop of the file calls it.
        bpy.ops.nmf.import_capture(
            "INVOKE_DEFAULT", True, directory=str(PHONE_CAPTURE.parent),
            files=[{"name": PHONE_CAPTURE.name}],
        )  # fmt: skip
    report["phone_cameras"] = cameras()
    report["phone_shown"] = yield from ui.wait(lambda: backgrounds() == 3, 20)
    area.tag_redraw()
    yield 0.5
    ui.shot(str(OUT / "1_phone_photos.png"))
    ui.move(400, 500)
    for key in ("phone_after_undo", "phone_after_two"):
        yield 0.2
        ui.key("ctrl+z")
        yield 1.0
        report[key] = [len(cameras()), backgrounds()]

    for attempt in ("imported", "imported_again"):
        with ui.override():
            # True: with an undo step, as from the menu.
            bpy.ops.nmf.import_capture("EXEC_DEFAULT", True, filepath=CAPTURE)
        report[attempt] = cameras()
        if attempt == "imported":
            yield 0.5
            ui.move(400, 500)
            yield 0.2
            ui.key("ctrl+z")
            yield 1.0
            report["after_import_undo"] = cameras()
    area.tag_redraw()
    yield 0.5
    ui.shot(str(OUT / "2_capture.png"))
    yield from ui.press("nmf.select_region_box")
    yield 0.5
    report["picked"] = [
        bpy.context.view_layer.objects.active.name,
        len(bpy.context.selected_objects),
    ]
    ui.click(*(yield from ui.find_prop("nmf.capture")))
    yield 1.0
    ui.shot(str(OUT / "2_captures_to_choose.png"))
    ui.key("Escape")
    yield 0.5

    monitor = job_monitor()
    os.environ["NMF_FAKE_MODE"], os.environ["NMF_FAKE_PAUSE"] = "normal", "0.4"
    yield from ui.press("nmf.reconstruct")
    report["started"] = yield from ui.wait(lambda: monitor.running, 5)
    report["previewed"] = yield from ui.wait(lambda: monitor.model.preview_version > 0, 30)
    yield 0.6
    ui.shot(str(OUT / "3_running.png"))
    report["overall"] = monitor.model.overall
    report["done"] = yield from ui.wait(lambda: not monitor.running and installed(), 30)
    yield 1.0
    ui.shot(str(OUT / "4_done.png"))
    report["installed"], report["world"] = installed(), bpy.context.scene.world.name
    ui.move(400, 500)
    yield 0.2
    ui.key("ctrl+z")
    yield 1.0
    report["after_undo"] = installed()

    os.environ["NMF_FAKE_MODE"], os.environ["NMF_FAKE_SECONDS"] = "slow", "90"
    yield from ui.press("nmf.reconstruct")
    yield from ui.wait(lambda: monitor.model.stage == "fit", 10)
    yield from ui.press("nmf.cancel")
    report["cancelled"] = yield from ui.wait(lambda: not monitor.running, 10)
    report["state"] = monitor.model.state
    yield 0.5
    ui.shot(str(OUT / "5_cancelled.png"))
    os.environ["NMF_FAKE_PAUSE"] = "0.01"
    yield from ui.press("nmf.resume")
    report["resumed"] = yield from ui.wait(lambda: not monitor.running and installed(), 20)

    ended = lambda: monitor.waits_to_install or not monitor.running  # noqa: E731
    os.environ["NMF_FAKE_MODE"] = "normal"
    for name in ("rendered", "moved", "duplicated"):
        for item in bpy.context.selected_objects:
            item.select_set(False)
        bpy.data.objects["Camera"].select_set(True)
        there = installed()
        with ui.override():
            bpy.ops.nmf.reconstruct("EXEC_DEFAULT", True)
            if name == "rendered":
                render_frames()
            elif name == "moved":
                bpy.ops.transform.translate("INVOKE_DEFAULT")
            else:
                bpy.ops.object.duplicate_move("INVOKE_DEFAULT")
        yield from ui.wait(ended, 20)
        yield 0.5
        report[name] = {"text": monitor.model.text, "meanwhile": installed() == there}
        ui.key("Escape")
        yield from ui.wait(lambda: not monitor.waits_to_install, 60)
        report[name]["after"] = len(installed()) - len(there)

    os.environ["NMF_FAKE_MODE"] = "raise"
    yield 0.5
    yield from ui.press("nmf.reconstruct")
    yield from ui.wait(lambda: monitor.running, 5)
    yield from ui.wait(lambda: not monitor.running, 10)
    yield 0.5
    ui.shot(str(OUT / "6_failed.png"))
    report["failure"] = monitor.model.error

    bpy.ops.preferences.addon_disable(module=MODULE)
    yield 0.5
    bpy.ops.preferences.addon_enable(module=MODULE)
    yield 1.0
    report["enabled_again"] = job_monitor().model.state
    ui.sidebar("NMF")
    yield 0.5

    os.environ["NMF_SOLVER_PYTHON"] = ""
    sys.modules[MODULE + ".nmf_addon.runtime"].forget()
    area.tag_redraw()
    yield 0.5
    ui.shot(str(OUT / "7_not_set_up.png"))
    report["setup_button"] = (yield from ui.find_button("nmf.setup_solver")) is not None
    bpy.ops.preferences.addon_show(module=MODULE)
    (OUT / "report.json").write_text(json.dumps(report))
    yield 1.0
