"""Solve Cameras and Check Capture: background tasks with a stand-in for the solver."""

import json
import shutil
from pathlib import Path
from types import SimpleNamespace

import bpy
import fake_capture
import numpy as np
import pytest
from drawing import Layout
from mathutils import Matrix

from solver.cameras.folder import CAMERA_MODELS, SolveRequest


@pytest.fixture
def photos(tmp_path):
    """A folder of photos without cameras; a file saved beside it, so jobs go to a known place."""
    folder = fake_capture.write_capture(tmp_path / "scan ö", 5).parent / "photos"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    return folder


def test_solved_cameras_are_imported_with_their_photos(extension, task, photos, fake_solver, tmp_path):
    assert bpy.ops.nmf.solve_cameras(directory=str(photos), single_camera=True) == {"FINISHED"}
    task.finish(lambda: task.model.stage == "matching" or not task.running)
    assert "Comparing photos" in task.model.text
    before = sorted(p.name for p in photos.iterdir())
    task.finish()
    assert task.model.state == "done" and task.model.text == "5 of 6 photos have a camera"
    assert task.model.warnings == ["the last photo overlaps no other"]
    collection = bpy.context.scene.nmf.capture
    cameras = [item for item in collection.objects if item.type == "CAMERA"]
    assert len(cameras) == 5
    photo = extension("scene.cameras").photo_of(cameras[0])
    assert bpy.path.abspath(photo.filepath).startswith(str(photos))
    assert sorted(p.name for p in photos.iterdir()) == before, "nothing is written beside photos"
    assert (tmp_path / "nmf_jobs").is_dir()


def test_cameras_of_a_video_are_imported_with_the_photos_taken_from_it(
    extension, task, fake_solver, tmp_path
):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    video = tmp_path / "Walk ö.MOV"
    video.write_bytes(b"frames")
    # As the file browser leaves it: with the folder that the video is in.
    result = bpy.ops.nmf.solve_cameras(
        filepath=str(video), directory=str(tmp_path), video_photos=4, single_camera=True
    )
    assert result == {"FINISHED"}
    task.finish()
    assert task.model.state == "done" and task.model.text == "4 of 5 photos have a camera"
    collection = bpy.context.scene.nmf.capture
    cameras = [item for item in collection.objects if item.type == "CAMERA"]
    photo = extension("scene.cameras").photo_of(cameras[0])
    job = tmp_path / "nmf_jobs" / "Walk_ö_cameras"
    assert Path(bpy.path.abspath(photo.filepath)).parent == job / "photos"


def test_cameras_of_an_archive_are_solved_from_the_folder_that_it_is_unpacked_to(
    extension, task, photos, fake_solver, tmp_path
):
    shutil.make_archive(str(tmp_path / "Shots"), "zip", photos)
    result = bpy.ops.nmf.solve_cameras(
        filepath=str(tmp_path / "Shots.zip"), directory=str(tmp_path), single_camera=True
    )
    assert result == {"FINISHED"}
    task.finish()
    assert task.model.text == "5 of 6 photos have a camera"
    collection = bpy.context.scene.nmf.capture
    cameras = [item for item in collection.objects if item.type == "CAMERA"]
    photo = extension("scene.cameras").photo_of(cameras[0])
    assert Path(bpy.path.abspath(photo.filepath)).parent == tmp_path / "Shots"


def test_archives_of_masks_and_of_what_is_to_be_ignored_go_to_the_solver_as_their_folders(
    task, photos, fake_solver, tmp_path
):
    for name in ("silhouettes", "hands"):
        shutil.make_archive(str(photos.with_name(name)), "zip", photos)
    whole = str(photos.with_name("hands.zip"))
    result = bpy.ops.nmf.solve_cameras(directory=str(photos), masks="../silhouettes.zip", ignored=whole)
    assert result == {"FINISHED"}
    task.finish()
    (begun,) = (tmp_path / "nmf_jobs").glob("*/solve.json")
    asked = json.loads(begun.read_text("utf-8"))
    assert asked["masks"] == str(photos.with_name("silhouettes"))
    assert asked["ignored"] == str(photos.with_name("hands"))


@pytest.mark.parametrize("stated", ["../silhouettes", "//scan ö/silhouettes", "whole"])
def test_masks_go_to_the_solver_and_to_the_capture(
    extension, task, photos, fake_solver, tmp_path, capfd, stated
):
    masks = photos.with_name("silhouettes")
    shutil.copytree(photos, masks)
    stated = str(masks) if stated == "whole" else stated
    result = bpy.ops.nmf.solve_cameras(directory=str(photos), masks=f" {stated} ")
    assert result == {"FINISHED"}
    assert f"Only what the masks in {masks} show" in capfd.readouterr().out
    task.finish()
    (begun,) = (tmp_path / "nmf_jobs").glob("*/solve.json")
    assert json.loads(begun.read_text("utf-8"))["masks"] == str(masks)
    cameras = extension("scene.capture_collection").photo_cameras(bpy.context.scene.nmf.capture)
    solver = [extension("scene.cameras").to_solver(item, Matrix()) for item in cameras]
    assert [c.mask_path for c in solver] == [masks / c.image_path.name for c in solver]


def test_masks_that_are_of_no_use_are_told_before_the_solver_starts(task, photos, tmp_path):
    with pytest.raises(RuntimeError, match=r"nowhere, masks: there is no such folder"):
        bpy.ops.nmf.solve_cameras(directory=str(photos), masks="nowhere")
    (tmp_path / "walk.mp4").write_bytes(b"frames")
    with pytest.raises(RuntimeError, match="a video's photos have no masks yet; give none, or"):
        bpy.ops.nmf.solve_cameras(filepath=str(tmp_path / "walk.mp4"), masks=str(photos))
    assert not task.running


@pytest.mark.parametrize("stated", ["../hands", "../hands/r_1.png", "whole"])
def test_what_is_to_be_ignored_goes_to_the_solver_and_to_the_capture(
    extension, task, photos, fake_solver, tmp_path, capfd, stated
):
    hands = photos.with_name("hands")
    hands.mkdir()
    shutil.copy(photos / "r_1.png", hands)
    whole = hands if stated == "whole" else photos.parent / stated.removeprefix("../")
    stated = str(hands) if stated == "whole" else stated
    result = bpy.ops.nmf.solve_cameras(directory=str(photos), ignored=f" {stated} ")
    assert result == {"FINISHED"}
    assert f"What is white in {whole} is ignored" in capfd.readouterr().out
    task.finish()
    (begun,) = (tmp_path / "nmf_jobs").glob("*/solve.json")
    assert json.loads(begun.read_text("utf-8"))["ignored"] == str(whole)
    cameras = extension("scene.capture_collection").photo_cameras(bpy.context.scene.nmf.capture)
    solver = [extension("scene.cameras").to_solver(item, Matrix()) for item in cameras]
    of_all = whole.is_file()
    for camera in solver:
        has_one = of_all or camera.image_path.name == "r_1.png"
        assert camera.ignored_path == (hands / "r_1.png" if has_one else None)


def test_one_picture_of_what_is_to_be_ignored_is_for_all_photos_of_a_video(
    extension, task, photos, fake_solver, tmp_path
):
    (tmp_path / "Walk ö.MOV").write_bytes(b"frames")
    shutil.copy(photos / "r_1.png", tmp_path / "leg.png")
    bpy.ops.nmf.solve_cameras(filepath=str(tmp_path / "Walk ö.MOV"), video_photos=4, ignored="leg.png")
    task.finish()
    cameras = extension("scene.capture_collection").photo_cameras(bpy.context.scene.nmf.capture)
    solver = [extension("scene.cameras").to_solver(item, Matrix()) for item in cameras]
    assert {camera.ignored_path for camera in solver} == {tmp_path / "leg.png"}


def test_pictures_to_ignore_that_are_of_no_use_are_told_before_the_solver_starts(task, photos, tmp_path):
    with pytest.raises(RuntimeError, match=r"nowhere, ignore: there is no such folder or picture"):
        bpy.ops.nmf.solve_cameras(directory=str(photos), ignored="nowhere")
    (tmp_path / "walk.mp4").write_bytes(b"frames")
    with pytest.raises(RuntimeError, match="a video's photos have no pictures there yet; give one picture"):
        bpy.ops.nmf.solve_cameras(filepath=str(tmp_path / "walk.mp4"), ignored=str(photos))
    assert not task.running


def test_the_file_browser_asks_for_masks_and_keeps_them_for_the_next_time():
    shown, settings = Layout(), bpy.ops.nmf.solve_cameras.get_rna_type()
    browser = SimpleNamespace(layout=shown, bl_rna=settings)
    bpy.types.NMF_OT_solve_cameras.draw(browser, bpy.context)
    for name in ("masks", "ignored"):
        assert ("prop", name) in shown.drawn
        assert not settings.properties[name].is_skip_save


@pytest.mark.parametrize("chosen, model", [({}, "OPENCV"), ({"camera_model": "PINHOLE"}, "PINHOLE")])
def test_the_lens_model_goes_to_the_solver(task, photos, fake_solver, tmp_path, chosen, model):
    bpy.ops.nmf.solve_cameras(directory=str(photos), **chosen)
    task.finish()
    (begun,) = (tmp_path / "nmf_jobs").glob("*/solve.json")
    assert json.loads(begun.read_text("utf-8"))["camera_model"] == model


def test_the_file_browser_asks_for_a_lens_model_that_the_solver_knows():
    shown, settings = Layout(), bpy.ops.nmf.solve_cameras.get_rna_type()
    bpy.types.NMF_OT_solve_cameras.draw(SimpleNamespace(layout=shown, bl_rna=settings), bpy.context)
    assert ("prop", "camera_model") in shown.drawn
    lenses = settings.properties["camera_model"].enum_items
    assert set(lenses.keys()) <= set(CAMERA_MODELS)
    assert all(lens.name and lens.description for lens in lenses)
    # What a solve that fails tells a person to choose.
    assert lenses["SIMPLE_RADIAL"].name == "Simple Radial"
    assert settings.properties["camera_model"].name == "Lens Model"
    assert settings.properties["camera_model"].default == SolveRequest("", ()).camera_model


def test_a_photo_that_is_picked_stands_for_its_folder(task, photos, fake_solver):
    bpy.ops.nmf.solve_cameras(filepath=str(photos / "r_0.png"), directory=str(photos))
    task.finish()
    assert task.model.text == "5 of 6 photos have a camera"


def test_a_solve_that_fails_says_which_photos_and_imports_nothing(task, photos, fake_solver):
    fake_solver("fail")
    bpy.ops.nmf.solve_cameras(directory=str(photos))
    task.finish()
    assert task.model.state == "failed" and "r_0.png is plain" in task.model.error
    assert not [item for item in bpy.data.objects if item.type == "CAMERA"]


def test_buttons_that_start_a_task_come_back_when_it_is_over(draw, task, capture, fake_solver):
    """A fixed bug: greyed while the pointer rested on it, a button stayed grey."""
    starts = {("operator", f"nmf.{name}") for name in ("solve_cameras", "check_capture")}
    assert starts <= set(draw("capture")[0])
    bpy.ops.nmf.check_capture()
    assert not starts & set(draw("capture")[0])
    task.finish()
    assert starts <= set(draw("capture")[0])


def test_a_solve_is_cancelled(task, photos, fake_solver):
    fake_solver("slow")
    bpy.ops.nmf.solve_cameras(directory=str(photos))
    task.finish(lambda: task.model.stage != "")
    with pytest.raises(RuntimeError, match="poll"):
        bpy.ops.nmf.solve_cameras(directory=str(photos))
    bpy.ops.nmf.cancel_task()
    task.finish()
    assert task.model.state == "cancelled"


def test_a_folder_that_is_not_there_is_named(extension, tmp_path):
    with pytest.raises(RuntimeError, match="nowhere: there is no such folder"):
        bpy.ops.nmf.solve_cameras(directory=str(tmp_path / "nowhere"))
    with pytest.raises(RuntimeError, match="nowhere.mp4: there is no such"):
        bpy.ops.nmf.solve_cameras(filepath=str(tmp_path / "nowhere.mp4"))


def test_findings_of_a_check_stay_with_the_capture_and_show_in_its_panel(
    extension, task, capture, fake_solver
):
    findings = extension("scene.findings")
    bpy.context.scene.nmf.device = "cpu"
    assert bpy.ops.nmf.check_capture() == {"FINISHED"}
    task.finish()
    assert task.model.text == "Check: 1 warning"
    report = json.loads(capture[findings.FINDINGS])
    assert report["findings"][0]["photo"] == "r_0" and report["estimate"]["text"].endswith("on cpu")
    assert [f["level"] for f in report["findings"]] == ["warning", "note"]
    assert bpy.context.scene.nmf.job == "", "a check is no job"


def test_what_a_check_said_stands_beside_its_capture_until_it_is_undone(
    draw, task, capture, fake_solver, add_capture
):
    other = add_capture("another")
    bpy.context.scene.nmf.capture = capture
    bpy.ops.ed.undo_push(message="before the check")
    bpy.ops.nmf.check_capture()
    task.finish()
    assert "Check: 1 warning" in draw("capture")[1]
    bpy.context.scene.nmf.capture = other
    assert "Check: " not in draw("capture")[1]
    bpy.context.scene.nmf.capture = capture
    bpy.ops.ed.undo()
    assert "Check: " not in draw("capture")[1]


def test_what_a_solve_said_goes_with_its_cameras_and_comes_back_with_them(draw, task, photos, fake_solver):
    bpy.ops.ed.undo_push(message="before the solve")
    bpy.ops.nmf.solve_cameras(directory=str(photos))
    task.finish()
    for _ in range(2):
        words = draw("capture")[1]
        assert "5 of 6 photos have a camera" in words and "overlaps no other" in words
        bpy.ops.ed.undo()
        words = draw("capture")[1]
        assert "have a camera" not in words and "overlaps no other" not in words
        bpy.ops.ed.redo()


def test_what_a_task_said_of_one_file_is_not_told_of_the_next(draw, task, photos, fake_solver):
    fake_solver("fail")
    bpy.ops.nmf.solve_cameras(directory=str(photos))
    task.finish()
    assert "r_0.png is plain" in draw("capture")[1]
    bpy.ops.wm.read_homefile(use_empty=True)
    assert "is plain" not in draw("capture")[1] and task.model.state == "new"


def test_the_region_box_is_selected_also_where_it_is_hidden(extension, capture):
    box = extension("scene.region").region_box(capture)
    box.hide_set(True)
    assert bpy.ops.nmf.select_region_box() == {"FINISHED"}
    assert bpy.context.selected_objects == [box] == [bpy.context.view_layer.objects.active]
    capture.hide_viewport = True
    with pytest.raises(RuntimeError, match="Region is hidden; show it, or its collection"):
        bpy.ops.nmf.select_region_box()
    bpy.data.objects.remove(box)
    assert not bpy.ops.nmf.select_region_box.poll()
    capture.hide_viewport = False
    bpy.ops.nmf.add_region_box()
    assert bpy.context.view_layer.objects.active == extension("scene.region").region_box(capture)


def test_a_check_fits_the_region_box_to_the_masks_unless_somebody_has_moved_it(
    extension, task, capture, fake_solver
):
    region = extension("scene.region")
    shown = [[-0.5, -0.25, 0.0], [0.5, 0.25, 1.0]]
    box = region.region_box(capture)
    bpy.ops.nmf.check_capture()
    task.finish()
    np.testing.assert_allclose(box.location, np.mean(shown, 0), atol=1e-6)
    np.testing.assert_allclose(box.scale, (0.5, 0.25, 0.5), atol=1e-6)
    box.location.x += 0.1
    moved = list(box.location)
    bpy.ops.nmf.check_capture()
    task.finish()
    assert list(box.location) == moved
    assert bpy.ops.nmf.fit_region_box() == {"FINISHED"}
    np.testing.assert_allclose(box.location, np.mean(shown, 0), atol=1e-6)
    root = box.parent
    root.location, root.scale = (5, 0, 0), (0.5, 0.5, 0.5)
    bpy.context.view_layer.update()
    stood = box.matrix_world.copy()
    box.parent = None  # Clear Parent and Keep Transform
    box.matrix_world = stood
    bpy.ops.nmf.fit_region_box()
    found = region.region_of(capture)
    np.testing.assert_allclose([found["min"], found["max"]], shown, atol=1e-5)
    bpy.data.objects.remove(box)
    bpy.ops.nmf.fit_region_box()
    found = region.region_of(capture)
    np.testing.assert_allclose([found["min"], found["max"]], shown, atol=1e-6)


def test_a_check_fits_the_box_of_cameras_in_the_scenes_own_collection(
    extension, task, capture, fake_solver
):
    whole = bpy.context.scene.collection
    for item in capture.objects:
        whole.objects.link(item)
    bpy.data.collections.remove(capture)
    bpy.ops.nmf.check_capture()
    task.finish()
    box = extension("scene.region").region_box(whole)
    np.testing.assert_allclose(box.scale, (0.5, 0.25, 0.5), atol=1e-6)


def test_what_a_check_finds_comes_to_its_capture_under_another_name(
    extension, task, capture, fake_solver, add_capture
):
    findings, region = extension("scene.findings"), extension("scene.region")
    name, box = capture.name, region.region_box(capture)
    bpy.ops.nmf.check_capture()
    capture.name = "Teapot"
    other = add_capture("another")
    other.name = name
    task.finish()
    assert findings.check_report(capture)["findings"] and not findings.check_report(other)
    np.testing.assert_allclose(box.scale, (0.5, 0.25, 0.5), atol=1e-6)


def test_a_check_ends_well_in_another_scene(extension, task, capture, fake_solver):
    bpy.ops.nmf.check_capture()
    bpy.context.window.scene = bpy.data.scenes.new("Other")
    task.finish()
    assert task.model.state == "done" and task.model.text.startswith("Check:")
    assert extension("scene.findings").check_report(capture)["findings"]


def test_without_masks_there_is_nothing_to_fit_the_box_to(extension, capture):
    with pytest.raises(RuntimeError, match="Press Check Capture first, with photos that have masks"):
        bpy.ops.nmf.fit_region_box()


def test_the_task_ends_with_the_extension(extension, task, photos, fake_solver, package):
    fake_solver("slow")
    bpy.ops.nmf.solve_cameras(directory=str(photos))
    task.finish(lambda: task.model.stage != "")
    process = task.process.popen
    package.unregister()
    assert process.wait(10) is not None
    package.register()


def test_what_a_task_finds_is_not_put_into_another_file(task, photos, fake_solver):
    bpy.ops.nmf.solve_cameras(directory=str(photos))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    task.finish()
    assert not bpy.data.collections
    assert "another file" in task.model.text and "Import Capture from" in task.model.text
    assert f"Photos: {photos}" in task.model.text


def test_what_a_task_finds_is_put_into_its_file_that_was_opened_once_more(
    task, photos, fake_solver, tmp_path
):
    """A fixed bug: File › Revert while cameras were solved lost them."""
    path = str(tmp_path / "scene.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.nmf.solve_cameras(directory=str(photos))
    bpy.ops.wm.open_mainfile(filepath=path)
    task.finish()
    assert bpy.context.scene.nmf.capture is not None
    assert "photos have a camera" in task.model.text


def test_a_solve_that_was_stopped_goes_on_in_its_folder(task, photos, fake_solver, tmp_path):
    fake_solver("slow")
    for _ in range(2):
        bpy.ops.nmf.solve_cameras(directory=str(photos))
        task.finish(lambda: task.model.stage != "")
        bpy.ops.nmf.cancel_task()
        task.finish()
    folders = {path.parent.name for path in (tmp_path / "nmf_jobs").glob("*/solve.json")}
    assert len(folders) == 1
    fake_solver("normal")
    bpy.ops.nmf.solve_cameras(directory=str(photos))
    task.finish()
    assert task.model.state == "done"
    bpy.ops.nmf.solve_cameras(directory=str(photos))
    task.finish()
    assert len(list((tmp_path / "nmf_jobs").glob("*/transforms_train.json"))) == 2


def test_a_task_that_cannot_be_followed_does_not_block_the_next(
    task, photos, fake_solver, extension, monkeypatch
):
    fake_solver("slow")
    bpy.ops.nmf.solve_cameras(directory=str(photos))

    def broken(*_):
        raise SystemError("no console")

    monkeypatch.setattr(extension("jobs.side_task"), "take_in", broken)
    assert extension("jobs.side_task")._tick() is None
    assert not task.running and task.model.state == "lost"
    assert bpy.ops.nmf.solve_cameras.poll()
